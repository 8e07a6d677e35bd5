"""Preparation against closed forms, trimesh and exact mesh queries."""

from __future__ import annotations

import dataclasses
import re

import igl
import numpy as np
import pytest
import trimesh

from dmfc.config.objects import PrepareConfig
from dmfc.errors import DmfcError, MachineError
from dmfc.objects.convex import convex_parts
from dmfc.objects.mass import implausible_mass
from dmfc.objects.mesh import clean
from dmfc.objects.model import ObjectModel
from dmfc.objects.prepare import prepare
from dmfc.objects.sdf import signed_distance_grid
from dmfc.objects.source import ObjectSource
from dmfc.objects.sources import find_object

CONFIG = PrepareConfig(
    sdf_spacing=0.002,
    convex_threshold=0.005,
    convex_iterations=4,
    convex_resolution=300,
    surface_points=1000,
)
BOX = (0.04, 0.06, 0.10)


def source_of(mesh: trimesh.Trimesh, name: str = "test/mesh", mass: float | None = None):
    return ObjectSource(name, "none", mass, "", name, lambda: mesh)


def prepared(mesh: trimesh.Trimesh, mass: float | None = None) -> ObjectModel:
    return prepare(source_of(mesh, mass=mass), CONFIG)


@pytest.fixture(scope="module")
def box() -> ObjectModel:
    return prepared(trimesh.creation.box(BOX))


@pytest.fixture(scope="module")
def cup() -> ObjectModel:
    return prepare(find_object("procedural/cup-0001"), CONFIG)


def exact_signed_distance(points: np.ndarray, vertices: np.ndarray, faces: np.ndarray):
    """Signed distance at points [n, 3] by query of the mesh itself -> [n], positive inside."""
    faces = faces.astype(np.int64)
    squared, _, _ = igl.point_mesh_squared_distance(points, vertices, faces)
    inside = igl.fast_winding_number(vertices.astype(np.float64), faces, points) > 0.5
    return np.where(inside, 1.0, -1.0) * np.sqrt(squared)


def band_error(model: ObjectModel, band: float, seed: int = 0, count: int = 4000) -> float:
    """Largest error of the grid within `band` metres of the surface, against exact queries."""
    rng = np.random.default_rng(seed)
    chosen = rng.integers(0, len(model.surface_points), count)
    offset = rng.uniform(-band, band, (count, 1)) * model.surface_normals[chosen]
    points = model.surface_points[chosen].astype(np.float64) + offset
    exact = exact_signed_distance(points, model.vertices, model.faces)
    near = np.abs(exact) < band
    return float(np.abs(model.sdf.distance(points) - exact)[near].max())


def test_box_closed_form(box):
    half = np.array(BOX) / 2
    points = np.random.default_rng(0).uniform(-half - 0.02, half + 0.02, (3000, 3))
    q = np.abs(points) - half
    outside = np.linalg.norm(np.maximum(q, 0), axis=1) + np.minimum(q.max(axis=1), 0)
    np.testing.assert_allclose(box.sdf.distance(points), -outside, atol=0.0013)
    volume = np.prod(BOX)
    assert box.mass == pytest.approx(400 * volume)
    moments = [BOX[1] ** 2 + BOX[2] ** 2, BOX[0] ** 2 + BOX[2] ** 2, BOX[0] ** 2 + BOX[1] ** 2]
    np.testing.assert_allclose(box.inertia, box.mass / 12 * np.diag(moments), atol=1e-9)
    assert len(box.convex_parts) == 1
    assert len(box.convex_parts[0]) == 8


def test_box_poses(box):
    assert len(box.stable_heights) == 6
    assert box.stable_probabilities.sum() == pytest.approx(1)
    assert np.all(np.diff(box.stable_probabilities) <= 1e-12)
    np.testing.assert_allclose(box.stable_rotations[box.standard_pose], np.eye(3), atol=1e-9)
    assert box.stable_heights[box.standard_pose] == pytest.approx(0.05)
    for rotation, height in zip(box.stable_rotations, box.stable_heights, strict=True):
        np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-9)
        assert np.linalg.det(rotation) == pytest.approx(1)
        lowest = (box.vertices @ rotation.T)[:, 2].min() + height
        assert lowest == pytest.approx(0, abs=1e-9)


def test_sphere_closed_form():
    radius = 0.03
    model = prepared(trimesh.creation.icosphere(4, radius), mass=0.058)
    points = np.random.default_rng(0).normal(size=(2000, 3))
    points *= np.random.default_rng(1).uniform(0.01, 0.05, (2000, 1)) / np.linalg.norm(
        points, axis=1, keepdims=True
    )
    expected = radius - np.linalg.norm(points, axis=1)
    np.testing.assert_allclose(model.sdf.distance(points), expected, atol=0.0005)
    assert model.mass == 0.058
    np.testing.assert_allclose(
        model.inertia, 0.4 * 0.058 * radius**2 * np.eye(3), rtol=0.01, atol=1e-8
    )
    np.testing.assert_allclose(model.com, 0, atol=1e-6)
    assert len(model.convex_parts) == 1


def test_cup_distance_in_the_band(cup):
    mesh = clean(find_object("procedural/cup-0001").load(), "cup")
    spacing, margin = PrepareConfig.sdf_spacing, PrepareConfig.sdf_margin
    grid = signed_distance_grid(mesh.vertices, mesh.faces, True, spacing, margin, 10**7)
    assert band_error(dataclasses.replace(cup, sdf=grid), 0.02) < 0.001


def test_cup_is_hollow(cup):
    """The cavity is outside by the grid and free of convex parts; the wall is not."""
    axis = np.array([[0, 0, z] for z in np.linspace(0.03, 0.09, 5)])
    assert np.all(cup.sdf.distance(axis) < -0.015)
    for part in cup.convex_parts:
        hull = trimesh.convex.convex_hull(part)
        assert not hull.contains(axis).any()
    assert 2 <= len(cup.convex_parts) <= CONFIG.convex_max_parts
    wall = exact_signed_distance(cup.surface_points.astype(float), cup.vertices, cup.faces)
    assert np.abs(wall).max() < 1e-6


def test_surface_samples(cup):
    mesh = trimesh.Trimesh(cup.vertices, cup.faces)
    inward = cup.surface_points - 0.0005 * cup.surface_normals
    assert np.mean(mesh.contains(inward)) > 0.99
    np.testing.assert_allclose(np.linalg.norm(cup.surface_normals, axis=1), 1, atol=1e-5)


def test_parts_are_repeatable(cup):
    mesh = clean(find_object("procedural/cup-0001").load(), "cup")
    again = convex_parts(mesh, CONFIG)
    assert [len(part) for part in again] == [len(part) for part in cup.convex_parts]
    np.testing.assert_array_equal(np.concatenate(again), np.concatenate(cup.convex_parts))
    assert mesh.sha256 == cup.mesh_sha256


def test_file_round_trip(cup, tmp_path):
    path = tmp_path / "deep" / "cup.npz"
    cup.save(path)
    loaded = ObjectModel.load(path)
    for field in dataclasses.fields(ObjectModel):
        if field.name == "sdf":
            np.testing.assert_allclose(loaded.sdf.values, cup.sdf.values, atol=6e-6)
            np.testing.assert_array_equal(loaded.sdf.origin, cup.sdf.origin)
            assert loaded.sdf.spacing == cup.sdf.spacing
        elif field.name == "convex_parts":
            for a, b in zip(loaded.convex_parts, cup.convex_parts, strict=True):
                np.testing.assert_array_equal(a, b)
        else:
            np.testing.assert_array_equal(getattr(loaded, field.name), getattr(cup, field.name))
    assert [p.name for p in path.parent.iterdir()] == ["cup.npz"]
    path.write_bytes(b"junk")
    with pytest.raises(DmfcError, match="cannot be read"):
        ObjectModel.load(path)


def test_pinched_and_inverted_meshes_have_the_right_sign():
    """Two boxes that share an edge: four faces meet there, so it is not watertight."""
    first = trimesh.creation.box((0.04, 0.04, 0.04))
    second = first.copy()
    second.apply_translation([0.04, 0.04, 0])
    pinched = trimesh.util.concatenate(first, second)
    pinched.invert()
    mesh = clean(pinched, "pinched")
    assert mesh.closed
    grid = signed_distance_grid(mesh.vertices, mesh.faces, mesh.closed, 0.002, 0.01, 10**6)
    inside = grid.distance(np.array([[0, 0, 0], [0.04, 0.04, 0], [0.04, 0, 0]]))
    np.testing.assert_allclose(inside, [0.02, 0.02, -0.02], atol=0.0015)


def test_open_mesh_uses_voxels_and_the_winding_number():
    """A ball with a hole too wide to be filled by one polygon keeps its sign and its mass."""
    ball = trimesh.creation.icosphere(3, 0.04)
    ball.update_faces(ball.triangles_center[:, 2] < 0.034)
    open_mesh = trimesh.Trimesh(ball.vertices, ball.faces)
    grid = signed_distance_grid(
        open_mesh.vertices, np.asarray(open_mesh.faces), False, 0.002, 0.01, 10**6
    )
    np.testing.assert_allclose(grid.distance(np.zeros((1, 3))), 0.04, atol=0.002)
    assert grid.distance(np.array([[0.0, 0.0, -0.045]])) < 0
    model = prepared(open_mesh, mass=1.0)
    assert np.all(np.linalg.eigvalsh(model.inertia) > 0)
    np.testing.assert_allclose(np.diag(model.inertia), 0.4 * 0.04**2, rtol=0.12)


def test_overlapping_bodies_count_once():
    first = trimesh.creation.box((0.04, 0.04, 0.04))
    second = first.copy()
    second.apply_translation([0.02, 0, 0])
    mesh = clean(trimesh.util.concatenate(first, second), "two")
    assert mesh.trimesh.volume == pytest.approx(0.06 * 0.04 * 0.04, rel=1e-5)


def test_voxel_budget():
    mesh = clean(trimesh.creation.box(BOX), "box")
    grid = signed_distance_grid(mesh.vertices, mesh.faces, True, 0.0005, 0.02, 20_000)
    assert grid.values.size <= 20_000
    np.testing.assert_allclose(grid.upper, np.array(BOX) / 2 + 0.02, atol=2 * grid.spacing)


def flat() -> trimesh.Trimesh:
    return trimesh.Trimesh(
        [[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0.1, 0.1, 0]], [[0, 1, 2], [1, 3, 2]]
    )


def not_finite() -> trimesh.Trimesh:
    box = trimesh.creation.box(BOX)
    vertices = box.vertices.copy()
    vertices[0, 0] = np.nan
    return trimesh.Trimesh(vertices, box.faces, process=False)


@pytest.mark.parametrize(
    ("mesh", "why"),
    [
        (flat(), "no volume"),
        (not_finite(), "not finite"),
        (trimesh.Trimesh(), "empty"),
        (trimesh.creation.box((40, 60, 100)), "another unit"),
    ],
)
def test_broken_meshes(mesh, why):
    with pytest.raises(DmfcError, match=why) as info:
        prepare(source_of(mesh, "test/broken"), CONFIG)
    assert "test/broken" in str(info.value)
    assert "\n" not in str(info.value)


def test_where_coacd_crashes_the_mesh_as_it_is_is_decomposed(tmp_path, monkeypatch):
    """A stand-in for CoACD that ends its process, then decomposes; and one that never does."""
    mesh = clean(two_boxes(), "test/mesh")
    marker = tmp_path / "asked"
    (tmp_path / "coacd.py").write_text(CRASHING.format(marker=str(marker)))
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    parts = convex_parts(mesh, CONFIG)
    assert marker.read_text() == "xx"
    (part,) = parts
    assert trimesh.convex.convex_hull(part).volume == pytest.approx(1e-6)
    (tmp_path / "coacd.py").write_text("import os\nos.abort()")
    with pytest.raises(DmfcError, match="CoACD crashed"):
        convex_parts(mesh, CONFIG)


@pytest.mark.parametrize(
    ("stand_in", "told"),
    [
        ("raise ImportError('no CoACD here')", "ImportError: no CoACD here"),
        ("raise MemoryError('no memory')", "MemoryError: no memory"),
        ("import os, signal; os.kill(os.getpid(), signal.SIGKILL)", r"killed \(signal 9\)"),
        (
            "import os, sys; print('std::bad_alloc', file=sys.stderr, flush=True); os.abort()",
            "bad_alloc",
        ),
    ],
)
def test_where_the_machine_ends_coacd_the_mesh_is_not_to_blame(
    tmp_path, monkeypatch, stand_in, told
):
    (tmp_path / "coacd.py").write_text(stand_in)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    with pytest.raises(MachineError, match=f"decomposition failed: .*{told}"):
        convex_parts(clean(two_boxes(), "test/mesh"), CONFIG)


def test_where_coacd_refuses_a_mesh_the_mesh_is_to_blame(tmp_path, monkeypatch):
    refusing = CRASHING.format(marker=str(tmp_path / "asked"))
    (tmp_path / "coacd.py").write_text(
        refusing.replace("    with open", "    raise RuntimeError('degenerate')\n    with open")
    )
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    with pytest.raises(DmfcError, match="decomposition failed: degenerate") as info:
        convex_parts(clean(two_boxes(), "test/mesh"), CONFIG)
    assert not isinstance(info.value, MachineError)


@pytest.mark.parametrize(
    ("limit", "work", "message"),
    [
        ("CPU_LIMIT", "while True: pass", r"within 1 s of CPU time \(objects\.prepare"),
        ("WALL_LIMIT", "import time; time.sleep(3600)", "within 1 s: this machine is overloaded"),
    ],
)
def test_a_decomposition_that_does_not_end_is_ended(tmp_path, monkeypatch, limit, work, message):
    (tmp_path / "coacd.py").write_text(f"def set_log_level(level):\n    {work}\n")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    monkeypatch.setattr(f"dmfc.objects.decompose.{limit}", 1)
    with pytest.raises(DmfcError, match=message):
        convex_parts(clean(two_boxes(), "test/mesh"), CONFIG)


CRASHING = """
import os, pathlib
import igl
import numpy as np
def set_log_level(level): pass
def Mesh(vertices, faces): return vertices
def run_coacd(mesh, **options):
    with open({marker!r}, "a") as file:
        file.write("x")
    if pathlib.Path({marker!r}).stat().st_size == 1:
        os.abort()
    corners = np.array(np.meshgrid([0, 0.01], [0, 0.01], [0, 0.01])).reshape(3, 8).T
    return [(corners, None)]
"""


def two_boxes() -> trimesh.Trimesh:
    apart = trimesh.creation.box(BOX)
    apart.apply_translation([0.2, 0, 0])
    return trimesh.util.concatenate([trimesh.creation.box(BOX), apart])


def pitcher(wall: float) -> trimesh.Trimesh:
    """A closed shell: 12 x 12 x 20 cm outside, walls of `wall` metres."""
    size = np.array([0.12, 0.12, 0.20])
    inner = trimesh.creation.box(size - 2 * wall)
    inner.invert()
    return trimesh.util.concatenate(trimesh.creation.box(size), inner)


def shell_mass(wall: float) -> float:
    size = np.array([0.12, 0.12, 0.20])
    return 400 * float(np.prod(size) - np.prod(size - 2 * wall))


@pytest.mark.parametrize(
    ("mesh", "known", "what"),
    [
        (pitcher(0.00006), None, r"test/mesh: a mass of 2\.\d+ g .* fills 2.88e\+03 cm\^3 .*"),
        (pitcher(0.005), None, ""),
        (pitcher(0.00006), 0.2, ""),
        (trimesh.creation.box(BOX), 240.0, r"2.4e\+05 g .*as its source has it"),
        (trimesh.creation.box(BOX), 0.001, r"a mass of 1 g is implausible"),
        (trimesh.creation.box(BOX), None, ""),
    ],
)
def test_an_implausible_mass_is_warned_of(mesh, known, what):
    model = prepare(source_of(mesh, mass=known), dataclasses.replace(CONFIG, convex_single=0.0))
    warning = implausible_mass(model)
    assert bool(warning) == bool(what)
    assert re.search(what, warning)
    if known is None and warning:
        assert model.mass == pytest.approx(shell_mass(0.00006), rel=1e-3)
        assert "mass from density 400 kg/m^3" in warning
        assert "objects.prepare.density" in warning
    assert "\n" not in warning
