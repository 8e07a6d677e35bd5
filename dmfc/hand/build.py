"""Build a `HandModel` from a hand's MJCF and description.

Inner points in the description, per link: a list of `[[x, y, z], [dx, dy, dz]]`, a ray in the link
frame. The point is where the ray last leaves the link's collision surface, its normal that of the
surface there.
"""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

from dmfc.config.closing import ClosingConfig
from dmfc.config.hand import HandConfig
from dmfc.errors import DmfcError
from dmfc.geometry.grid import Grid
from dmfc.geometry.points import farthest_points
from dmfc.geometry.transforms import apply, inverse, transform
from dmfc.hand.mjcf import PREFIX, HandDescription, hand_model, load_description
from dmfc.hand.model import HandModel
from dmfc.hand.surface import LinkSurface, link_surfaces, visual_mesh

CANDIDATES = 12
"""Surface samples drawn for every collision point that is kept."""
_TOLERANCE = 1e-4
"""rad by which an angle may be beyond its limits: both are rounded in files."""


def build_hand(config: HandConfig) -> HandModel:
    """The hand that `config.name` describes.

    Raises DmfcError if the MJCF has what a `HandModel` cannot hold, or the description is wrong.
    """
    description = load_description(config.name)
    model = hand_model(description)
    names = [model.body(body).name.removeprefix(PREFIX) for body in range(1, model.nbody)]
    tree = _tree(model, description, names)
    _check_angles(description, tree["lower"], tree["upper"])
    surfaces = link_surfaces(model)
    candidates = _candidates(surfaces, config)
    link, points = _collision_points(candidates, config.collision_points)
    inner = _inner_points(description, names, surfaces)
    visuals = [visual_mesh(model, i + 1, surface) for i, surface in enumerate(surfaces)]
    normal = np.array(description.palm_normal, dtype=np.float64)
    return HandModel(
        name=description.name,
        dof_names=description.dof_names,
        open_joints=description.open_joints,
        flexion=description.flexion_direction,
        link_names=names,
        palm_reference=np.array(description.palm_reference, dtype=np.float64),
        palm_normal=normal / np.linalg.norm(normal),
        collision_link=link,
        collision_points=points,
        **inner,
        adjacency=_adjacency(model, description, tree, surfaces, candidates),
        link_grids=[_grid(surface, config) for surface in surfaces],
        link_vertices=[np.asarray(mesh.vertices, dtype=np.float64) for mesh in visuals],
        link_faces=[np.asarray(mesh.faces, dtype=np.int32) for mesh in visuals],
        **tree,
        closing=ClosingConfig(),
    )


def _tree(
    model: mujoco.MjModel, description: HandDescription, names: list[str]
) -> dict[str, np.ndarray]:
    """Parents, rest transforms, joints and limits."""
    links, dofs = len(names), description.dof_names
    tree = {
        "parents": model.body_parentid[1:].astype(np.int64) - 1,
        "T_parent_link": np.tile(np.eye(4), (links, 1, 1)),
        "joint_axis": np.zeros((links, 3)),
        "joint_dof": np.full(links, -1, dtype=np.int64),
        "joint_scale": np.zeros(links),
        "lower": np.full(len(dofs), -np.inf),
        "upper": np.full(len(dofs), np.inf),
    }
    for i in range(links):
        matrix = np.empty(9)
        mujoco.mju_quat2Mat(matrix, model.body_quat[i + 1])
        if i > 0:
            tree["T_parent_link"][i] = transform(matrix.reshape(3, 3), model.body_pos[i + 1])
        if model.body_jntnum[i + 1] == 0:
            continue
        joint = int(model.body_jntadr[i + 1])
        name = model.joint(joint).name.removeprefix(PREFIX)
        _check_joint(model, i + 1, description)
        driver, ratio = _coupling(description, name)
        dof = dofs.index(driver)
        tree["joint_axis"][i] = model.jnt_axis[joint]
        tree["joint_dof"][i], tree["joint_scale"][i] = dof, ratio
        low, high = sorted(model.jnt_range[joint] / ratio)
        tree["lower"][dof] = max(tree["lower"][dof], low)
        tree["upper"][dof] = min(tree["upper"][dof], high)
    return tree


def _coupling(description: HandDescription, name: str) -> tuple[str, float]:
    """Degree of freedom that turns a joint, and the ratio of their angles."""
    if name not in description.couplings:
        return name, 1.0
    coupling = description.couplings[name]
    return coupling.driver, coupling.ratio


def _check_joint(model: mujoco.MjModel, body: int, description: HandDescription) -> None:
    joint = int(model.body_jntadr[body])
    wrong = None
    if model.body_jntnum[body] > 1:
        wrong = "has more than one joint"
    elif model.jnt_type[joint] != mujoco.mjtJoint.mjJNT_HINGE:
        wrong = "has a joint that is not a hinge"
    elif np.abs(model.jnt_pos[joint]).max() > 1e-9:
        wrong = "has a joint that is not at its origin"
    elif not model.jnt_limited[joint]:
        wrong = "has a joint without limits"
    if wrong:
        name = model.body(body).name.removeprefix(PREFIX)
        raise DmfcError(f"hand '{description.name}': body '{name}' {wrong} (key mjcf)")


def _check_angles(description: HandDescription, lower: np.ndarray, upper: np.ndarray) -> None:
    """Raises DmfcError for an angle of the open hand or of a pre-shape that no joint can have."""
    given = [("dofs", name, angle) for name, angle in description.dofs.items()]
    given += [
        ("preshape", name, end) for name, ends in description.preshape.items() for end in ends
    ]
    for key, name, angle in given:
        dof = description.dof_names.index(name)
        low, high = lower[dof] - _TOLERANCE, upper[dof] + _TOLERANCE
        if not low <= angle <= high:
            degrees = f"; {angle:g} degrees are {np.radians(angle):.4g} rad"
            raise DmfcError(
                f"hand '{description.name}': {key}.{name} is {angle:g} rad, but the joint turns "
                f"from {lower[dof]:.4g} to {upper[dof]:.4g} rad"
                + (degrees if low <= np.radians(angle) <= high else "")
            )


def _candidates(surfaces: list[LinkSurface], config: HandConfig) -> list[np.ndarray]:
    """Uniform samples of each link's outer surface, of one density for the whole hand."""
    area = sum(shape.mesh.area for surface in surfaces for shape in surface.shapes)
    if area == 0:
        raise DmfcError(f"hand '{config.name}' has no collision geometry (setting hand.name)")
    density = CANDIDATES * config.collision_points / area
    return [s.sample(density, config.seed + 1000 * i) for i, s in enumerate(surfaces)]


def _collision_points(candidates: list[np.ndarray], count: int) -> tuple[np.ndarray, np.ndarray]:
    """`count` points, shared among the links by area, spread evenly on each: link [n], [n, 3]."""
    sizes = np.array([len(points) for points in candidates])
    exact = count * sizes / sizes.sum()
    share = np.floor(exact).astype(int)
    share[np.argsort(share - exact, kind="stable")[: count - share.sum()]] += 1
    if (share > sizes).any():
        raise DmfcError(f"{count} collision points are too few to share among the links")
    chosen = [
        points[farthest_points(points, int(n))]
        for points, n in zip(candidates, share, strict=True)
        if n > 0
    ]
    return np.repeat(np.arange(len(share)), share), np.concatenate(chosen)


def _inner_points(
    description: HandDescription, names: list[str], surfaces: list[LinkSurface]
) -> dict[str, np.ndarray]:
    links, points, normals = [], [], []
    for name, rays in description.inner_points.items():
        if name not in names:
            raise DmfcError(f"hand '{description.name}': no body '{name}' (key inner_points)")
        surface = surfaces[names.index(name)]
        for ray in rays:
            start, direction = _ray(description, name, ray)
            links.append(names.index(name))
            points.append(surface.hit(start, direction))
            normals.append(surface.normals(points[-1][None])[0])
    if not links:
        raise DmfcError(f"hand '{description.name}' has no inner points (key inner_points)")
    return {
        "inner_link": np.array(links, dtype=np.int64),
        "inner_points": np.array(points),
        "inner_normals": np.array(normals),
    }


def _ray(description: HandDescription, name: str, ray: Any) -> tuple[np.ndarray, np.ndarray]:
    try:
        start, direction = np.array(ray, dtype=np.float64).reshape(2, 3)
    except (TypeError, ValueError) as error:
        raise DmfcError(
            f"hand '{description.name}': inner_points.{name} must be a list of "
            f"[[x, y, z], [dx, dy, dz]], not {ray}"
        ) from error
    return start, direction


def _adjacency(
    model: mujoco.MjModel,
    description: HandDescription,
    tree: dict[str, np.ndarray],
    surfaces: list[LinkSurface],
    candidates: list[np.ndarray],
) -> np.ndarray:
    """Pairs [L, L] that cannot collide, or always do.

    A link and its parent; a link and what is adjacent to its parent where both turn about one
    point (a universal joint); the pairs that the MJCF excludes; pairs that touch in the rest pose
    or the open hand.
    """
    parents, links = tree["parents"], len(surfaces)
    adjacent = np.eye(links, dtype=bool)
    for i in range(1, links):
        parent = parents[i]
        adjacent[i, parent] = adjacent[parent, i] = True
        if parent > 0 and np.abs(tree["T_parent_link"][i][:3, 3]).max() < 1e-9:
            above = parents[parent]
            adjacent[i, above] = adjacent[above, i] = True
    for signature in model.exclude_signature:
        first, second = int(signature) >> 16, int(signature) & 0xFFFF
        adjacent[first - 1, second - 1] = adjacent[second - 1, first - 1] = True
    for joints in (np.zeros(len(description.dofs)), description.open_joints):
        T_palm_link = _link_poses(model, description, joints)
        for i, j in zip(*np.nonzero(~adjacent), strict=True):
            if _touch(surfaces[j], candidates[i], inverse(T_palm_link[j]) @ T_palm_link[i]):
                adjacent[i, j] = adjacent[j, i] = True
    return adjacent


def _touch(surface: LinkSurface, points: np.ndarray, T_surface_points: np.ndarray) -> bool:
    """Whether any point of another link is inside the surface."""
    if not surface.shapes:
        return False
    lower, upper = surface.bounds
    placed = apply(T_surface_points, points)
    near = placed[((placed > lower) & (placed < upper)).all(axis=1)]
    return len(near) > 0 and bool(surface.distance(near).max() > 0)


def _link_poses(
    model: mujoco.MjModel, description: HandDescription, joints: np.ndarray
) -> np.ndarray:
    """T_palm_link [L, 4, 4] by MuJoCo; `joints` [D]."""
    data = mujoco.MjData(model)
    for joint in range(model.njnt):
        name = model.joint(joint).name.removeprefix(PREFIX)
        driver, ratio = _coupling(description, name)
        data.qpos[model.jnt_qposadr[joint]] = ratio * joints[description.dof_names.index(driver)]
    mujoco.mj_kinematics(model, data)
    return transform(data.xmat[1:].reshape(-1, 3, 3), data.xpos[1:])


def _grid(surface: LinkSurface, config: HandConfig) -> Grid:
    """Signed distance around a link; where it has no collision geometry, far outside everywhere."""
    if not surface.shapes:
        return Grid(np.full((2, 2, 2), -1.0), np.zeros(3), config.link_sdf_spacing)
    lower, upper = surface.bounds
    margin = config.link_sdf_margin
    return Grid.sample(surface.distance, lower - margin, upper + margin, config.link_sdf_spacing)
