"""Generated household shapes: no download, and as many as wanted.

Object number i is a function of i alone: its family goes round the list of families, its
dimensions are drawn from ranges of real household things that a human-sized hand can hold. All are
watertight, stand upright with the base on z = 0, and are centred on the z axis. Metres.

A large one is the object of that number scaled as a whole: what a hand spans with its fingers open.
"""

from __future__ import annotations

import re
from collections.abc import Callable

import manifold3d
import numpy as np
import trimesh
from manifold3d import Manifold as Solid

from dmfc.errors import unknown_name
from dmfc.objects.mesh import from_manifold

VERSION = 1
"""Raised when a shape of any number changes."""
LARGER = 1.25, 1.65
"""By how much a large one is scaled: balls up to 165 mm, boxes up to 330 mm long."""
_LARGE = "-large"
_SEGMENTS = 48


def generate(number: int, large: bool = False) -> trimesh.Trimesh:
    """The object of that number, or the large one of that number."""
    rng = np.random.default_rng([VERSION, number])
    solid = _FAMILIES[number % len(_FAMILIES)][1](rng)
    vertices, faces = from_manifold(solid.simplify(2e-5))
    lower, upper = vertices.min(axis=0), vertices.max(axis=0)
    vertices -= np.array([*(lower + upper)[:2] / 2, lower[2]])
    if large:
        vertices *= np.random.default_rng([VERSION, number, 1]).uniform(*LARGER)
    return trimesh.Trimesh(vertices, faces, process=False)


def name_of(number: int, large: bool = False) -> str:
    """The name of the object of that number, e.g. "bottle-0007" or "bottle-0007-large"."""
    family = _FAMILIES[number % len(_FAMILIES)][0]
    return f"{family}-{number:04d}{_LARGE if large else ''}"


def is_large(name: str) -> bool:
    """Whether a name is that of a large object."""
    return name.endswith(_LARGE)


def number_of(name: str) -> int:
    """The number in a name; DmfcError if no object has this name."""
    match = re.fullmatch(rf"[a-z]+-(\d{{4,}})(?:{_LARGE})?", name)
    number = int(match.group(1)) if match else 0
    if match is None or name_of(number, is_large(name)) != name:
        raise unknown_name(
            "procedural object", name, [name_of(i) for i in range(number, number + 2 * 12)]
        )
    return number


def _box(rng: np.random.Generator) -> Solid:
    """A carton or block: one side that a hand spans, edges a little rounded."""
    sides = np.array([rng.uniform(0.03, 0.08), rng.uniform(0.04, 0.14), rng.uniform(0.04, 0.20)])
    edge = rng.uniform(0.05, 0.15) * sides.min()
    slabs = [_cuboid(sides - 2 * edge * (1 - axis)) for axis in np.eye(3)]
    return Solid.batch_hull(slabs)


def _can(rng: np.random.Generator) -> Solid:
    """A tin: a cylinder with a rim above and below."""
    radius, height = rng.uniform(0.025, 0.048), rng.uniform(0.05, 0.16)
    rim = rng.uniform(0.0008, 0.002)
    profile = [(0, 0.002), (radius - 2 * rim, 0.002), (radius - 2 * rim, 0), (radius, 0)]
    profile += [(radius, 0.003), (radius - rim, 0.005), (radius - rim, height - 0.005)]
    profile += [(radius, height - 0.003), (radius, height), (radius - 2 * rim, height)]
    return _lathe([*profile, (radius - 2 * rim, height - 0.002), (0, height - 0.002)])


def _bottle(rng: np.random.Generator) -> Solid:
    """A closed bottle: body, shoulder, neck and cap; round or flattened."""
    radius, height = rng.uniform(0.024, 0.042), rng.uniform(0.13, 0.24)
    neck = rng.uniform(0.35, 0.55) * radius
    shoulder, top = rng.uniform(0.5, 0.7) * height, rng.uniform(0.78, 0.86) * height
    t = np.linspace(0, 1, 9)
    blend = (1 - np.cos(np.pi * t)) / 2
    curve = [
        (radius + (neck - radius) * b, shoulder + (top - shoulder) * s)
        for s, b in zip(t, blend, strict=True)
    ]
    waist = rng.uniform(0.9, 1.0) * radius
    body = [(0, 0), (0.9 * radius, 0), (radius, 0.06 * height), (waist, 0.5 * shoulder)]
    cap = [(neck, 0.9 * height), (1.15 * neck, 0.9 * height), (1.15 * neck, height), (0, height)]
    return _lathe([*body, *curve, *cap]).scale([1, rng.choice([1.0, rng.uniform(0.6, 0.9)]), 1])


def _cup(rng: np.random.Generator) -> Solid:
    """A tumbler with a real cavity."""
    return _vessel(
        base=rng.uniform(0.022, 0.032),
        rim=rng.uniform(0.030, 0.045),
        height=rng.uniform(0.06, 0.13),
        wall=rng.uniform(0.002, 0.004),
    )


def _bowl(rng: np.random.Generator) -> Solid:
    """A bowl: part of a hollow ball on a foot."""
    radius, wall = rng.uniform(0.05, 0.075), rng.uniform(0.003, 0.006)
    depth = rng.uniform(0.6, 0.95) * radius
    angles = np.linspace(0.25, np.arccos(1 - depth / radius), 12)
    outer = [(radius * np.sin(a), radius * (1 - np.cos(a))) for a in angles]
    inner = [((radius - wall) * np.sin(a), radius - (radius - wall) * np.cos(a)) for a in angles]
    base = radius * (1 - np.cos(0.25))
    foot = [(0, base - 0.004), (outer[0][0], base - 0.004)]
    return _lathe([*foot, *outer, *inner[::-1], (0, base + wall)])


def _ball(rng: np.random.Generator) -> Solid:
    """A ball, or an egg-shaped fruit."""
    radius = rng.uniform(0.02, 0.05)
    squash = rng.choice([1.0, rng.uniform(0.8, 1.25)])
    return Solid.sphere(radius, 40).scale([1, 1, squash])


def _bent(rng: np.random.Generator) -> Solid:
    """A banana-like body: ellipses swept along an arc, thin at the ends; it lies on the table."""
    length, bend = rng.uniform(0.12, 0.2), rng.uniform(0.4, 1.4)
    width, thickness = rng.uniform(0.013, 0.022), rng.uniform(0.7, 1.0)
    radius = length / bend
    rings = 24
    t = np.linspace(-1, 1, rings)
    size = width * np.maximum(1 - np.abs(t) ** 3, 0.0) ** 0.5
    size = np.maximum(size, 0.25 * width)
    around = np.linspace(0, 2 * np.pi, 20, endpoint=False)
    angle = t * bend / 2
    centre = radius * np.stack([np.sin(angle), np.cos(angle) - 1, np.zeros(rings)], axis=1)
    outward = np.stack([np.sin(angle), np.cos(angle), np.zeros(rings)], axis=1)
    ring = outward[:, None] * np.cos(around)[None, :, None]
    ring = ring + np.array([0, 0, thickness]) * np.sin(around)[None, :, None]
    return _swept(centre[:, None] + size[:, None, None] * ring)


def _taper(rng: np.random.Generator) -> Solid:
    """A block or cone with a smaller top: between round and square, sometimes twisted."""
    a, b = rng.uniform(0.02, 0.04), rng.uniform(0.02, 0.05)
    power = rng.choice([2.0, 3.0, 6.0])
    around = np.linspace(0, 2 * np.pi, _SEGMENTS, endpoint=False)
    cos, sin = np.cos(around), np.sin(around)
    x = a * np.sign(cos) * np.abs(cos) ** (2 / power)
    y = b * np.sign(sin) * np.abs(sin) ** (2 / power)
    outline = manifold3d.CrossSection([np.stack([x, y], axis=1)])
    top = rng.uniform(0.35, 0.85)
    twist = rng.choice([0.0, rng.uniform(-40, 40)])
    return outline.extrude(rng.uniform(0.06, 0.16), 12, twist, [top, top])


def _lid(rng: np.random.Generator) -> Solid:
    """A lid of a pot: a shallow dome with a knob."""
    radius, rise = rng.uniform(0.05, 0.09), rng.uniform(0.008, 0.02)
    wall = rng.uniform(0.003, 0.005)
    knob, stem = rng.uniform(0.012, 0.018), rng.uniform(0.006, 0.009)
    s = np.linspace(1, 0.15, 8)
    dome = [(radius * r, wall + rise * (1 - r * r)) for r in s]
    under = [(radius * r, rise * (1 - r * r)) for r in s[::-1]]
    top = wall + rise
    grip = [(stem, top), (stem, top + 0.008), (knob, top + 0.014), (knob, top + 0.022)]
    return _lathe([(0, rise), *under, *dome, *grip, (0.6 * knob, top + 0.027), (0, top + 0.027)])


def _mug(rng: np.random.Generator) -> Solid:
    """A cup with a handle at its side."""
    radius, height = rng.uniform(0.034, 0.045), rng.uniform(0.075, 0.11)
    wall = rng.uniform(0.003, 0.005)
    cup = _vessel(rng.uniform(0.85, 1.0) * radius, radius, height, wall)
    thick, reach = rng.uniform(0.0045, 0.0065), rng.uniform(0.25, 0.33) * height
    ring = manifold3d.CrossSection.circle(thick, 16).translate([reach, 0]).revolve(32)
    handle = ring.rotate([90, 0, 0]).scale([0.9, 1, 1]).translate([radius, 0, height / 2])
    filled = _vessel(0.85 * radius, radius, height, wall, hollow=False)
    return cup + (handle - filled)


def _tool(rng: np.random.Generator) -> Solid:
    """A handle with a head across its end, as of a hammer or brush, standing on the head."""
    grip, length = rng.uniform(0.011, 0.017), rng.uniform(0.12, 0.2)
    swell = rng.uniform(1.0, 1.3)
    profile = [(0, 0), (0.8 * grip, 0), (grip, 0.2 * length), (swell * grip, 0.7 * length)]
    handle = _lathe([*profile, (0.9 * grip, 0.97 * length), (0.6 * grip, length), (0, length)])
    half = rng.uniform(1.1, 1.8) * grip
    head = _cuboid(np.array([rng.uniform(0.07, 0.11), 2 * half, 2 * half]))
    return handle + head.translate([0, 0, half / 2])


def _ring(rng: np.random.Generator) -> Solid:
    """A roll or ring: a tube with a hole through it."""
    outer, height = rng.uniform(0.035, 0.06), rng.uniform(0.02, 0.06)
    inner = rng.uniform(0.45, 0.75) * outer
    edge = 0.15 * min(height, outer - inner)
    profile = [(inner, edge), (inner + edge, 0), (outer - edge, 0), (outer, edge)]
    profile += [(outer, height - edge), (outer - edge, height), (inner + edge, height)]
    return _lathe([*profile, (inner, height - edge)])


_FAMILIES: list[tuple[str, Callable[[np.random.Generator], Solid]]] = [
    ("box", _box),
    ("cup", _cup),
    ("bottle", _bottle),
    ("ball", _ball),
    ("mug", _mug),
    ("can", _can),
    ("bent", _bent),
    ("bowl", _bowl),
    ("taper", _taper),
    ("lid", _lid),
    ("tool", _tool),
    ("ring", _ring),
]


def _vessel(base: float, rim: float, height: float, wall: float, hollow: bool = True) -> Solid:
    outer = [(0, 0), (base, 0), (rim, height)]
    if not hollow:
        return _lathe([*outer, (0, height)])
    return _lathe([*outer, (rim - wall, height), (base - wall, 1.5 * wall), (0, 1.5 * wall)])


def _lathe(profile: list[tuple[float, float]]) -> Solid:
    """The profile (radius, height), counter-clockwise, turned about the z axis."""
    return manifold3d.CrossSection([np.array(profile, dtype=np.float64)]).revolve(_SEGMENTS)


def _cuboid(sides: np.ndarray) -> Solid:
    return Solid.cube([float(side) for side in sides], True)


def _swept(rings: np.ndarray) -> Solid:
    """The body through rings of points [r, n, 3], closed by a point in the middle of each end."""
    r, n, _ = rings.shape
    vertices = np.concatenate([rings.reshape(-1, 3), rings[[0, -1]].mean(axis=1)])
    i, j = np.meshgrid(np.arange(r - 1), np.arange(n), indexing="ij")
    a, b = i * n + j, i * n + (j + 1) % n
    sides = np.stack([a, b, b + n, a, b + n, a + n], axis=-1).reshape(-1, 3)
    one, following = np.arange(n), (np.arange(n) + 1) % n
    start = np.stack([np.full(n, r * n), following, one], axis=-1)
    end = np.stack([np.full(n, r * n + 1), one + (r - 1) * n, following + (r - 1) * n], axis=-1)
    faces = np.concatenate([sides, start, end])
    if trimesh.Trimesh(vertices, faces, process=False).volume < 0:
        faces = faces[:, ::-1]
    mesh = manifold3d.Mesh(vertices.astype(np.float32), faces.astype(np.uint32))
    return Solid(mesh)
