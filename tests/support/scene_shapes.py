"""Object models of simple shapes, built without the preparation stage, and grasps and a hand."""

from __future__ import annotations

import dataclasses
from itertools import pairwise

import igl
import numpy as np
import trimesh

from dmfc.config.closing import ClosingConfig
from dmfc.geometry.grid import Grid
from dmfc.grasps.grasp_set import GraspSet
from dmfc.hand.model import HandModel
from dmfc.objects.model import ObjectModel


def box_mesh(size: tuple[float, float, float]) -> trimesh.Trimesh:
    return trimesh.creation.box(size)


def cup_mesh(radius: float = 0.035, height: float = 0.09, wall: float = 0.006) -> trimesh.Trimesh:
    """A cup with a real cavity, open at +z."""
    profile = [
        *((0, 0), (radius, 0), (radius, height), (radius - wall, height)),
        *((radius - wall, wall), (0, wall)),
    ]
    return trimesh.creation.revolve(profile, sections=40)


def model_of(
    name: str,
    mesh: trimesh.Trimesh,
    parts: list[np.ndarray] | None = None,
    as_it_stands: bool = False,
) -> ObjectModel:
    """ObjectModel of a watertight mesh; `parts` are its convex pieces (default: itself).

    `as_it_stands` takes the mesh's own orientation for the one stable pose.
    """
    vertices = np.array(mesh.vertices, dtype=np.float64)
    faces = np.array(mesh.faces, dtype=np.int32)

    def signed(points: np.ndarray) -> np.ndarray:
        return -igl.signed_distance(points, vertices, faces.astype(np.int64))[0]

    margin = 0.02
    grid = Grid.sample(signed, vertices.min(0) - margin, vertices.max(0) + margin, 0.003)
    samples, index = trimesh.sample.sample_surface(mesh, 2000, seed=0)
    if as_it_stands:
        T_world_object, probability = np.eye(4)[None], np.ones(1)
        T_world_object[0, 2, 3] = -vertices[:, 2].min()
    else:
        T_world_object, probability = mesh.compute_stable_poses(sigma=0, n_samples=1)
    rotations = T_world_object[:, :3, :3]
    upright = int(np.argmax([np.trace(rotation) for rotation in rotations]))
    return ObjectModel(
        id=f"shape/{name}",
        vertices=vertices,
        faces=faces,
        watertight=bool(mesh.is_watertight),
        mass=0.2,
        com=np.array(mesh.center_mass),
        inertia=np.array(mesh.moment_inertia),
        convex_parts=parts or [vertices],
        sdf=grid,
        surface_points=np.asarray(samples, dtype=np.float32),
        surface_normals=mesh.face_normals[index].astype(np.float32),
        stable_rotations=rotations,
        stable_heights=T_world_object[:, 2, 3],
        stable_probabilities=probability,
        standard_pose=upright,
        source="test",
        licence="none",
        mesh_sha256=name,
        notes=[],
    )


def cup_model() -> ObjectModel:
    """The cup, its wall and floor as convex pieces."""
    mesh = cup_mesh()
    outer, inner, height, floor = 0.035, 0.029, 0.09, 0.006
    parts, angles = [], np.linspace(0, 2 * np.pi, 41)
    for left, right in pairwise(angles):
        ring = [
            (r * np.cos(a), r * np.sin(a), z)
            for r in (inner, outer)
            for a in (left, right)
            for z in (0, height)
        ]
        parts.append(np.array(ring))
    disc = [(outer * np.cos(a), outer * np.sin(a), z) for a in angles for z in (0, floor)]
    return model_of("cup", mesh, [*parts, np.array(disc)])


def shapes() -> dict[str, ObjectModel]:
    """Five objects of household size, one of them with a cavity."""
    made = [
        model_of("box", box_mesh((0.06, 0.09, 0.15))),
        model_of("slab", box_mesh((0.12, 0.08, 0.03))),
        model_of("can", trimesh.creation.cylinder(radius=0.033, height=0.1, sections=40)),
        model_of("cone", trimesh.creation.cone(radius=0.05, height=0.09, sections=32)),
        cup_model(),
    ]
    return {model.id: model for model in made}


def paddle() -> HandModel:
    """A hand that is a flat palm, 8 cm square, with one finger that bends towards its inside."""
    grid = np.linspace(-0.04, 0.04, 9)
    palm = np.stack(np.meshgrid(grid, grid, [0.0]), axis=-1).reshape(-1, 3)
    finger = np.stack([np.zeros(8), np.zeros(8), np.linspace(0, 0.05, 8)], axis=1)
    T_palm_finger = np.eye(4)
    T_palm_finger[0, 3] = 0.04
    small = Grid(np.zeros((2, 2, 2)), np.zeros(3), 0.01)
    return HandModel(
        name="paddle",
        dof_names=["bend"],
        lower=np.array([-1.0]),
        upper=np.array([1.0]),
        open_joints=np.zeros(1),
        flexion=np.ones(1),
        closing=ClosingConfig(opening=0.0, squeeze=0.0),
        link_names=["palm", "finger"],
        parents=np.array([-1, 0]),
        T_parent_link=np.stack([np.eye(4), T_palm_finger]),
        joint_axis=np.array([[0, 0, 0], [0, 1.0, 0]]),
        joint_dof=np.array([-1, 0]),
        joint_scale=np.array([0.0, 1.0]),
        palm_reference=np.array([0.0, 0.0, 0.01]),
        palm_normal=np.array([0.0, 0.0, 1.0]),
        collision_link=np.repeat([0, 1], [len(palm), len(finger)]),
        collision_points=np.concatenate([palm, finger]),
        inner_link=np.zeros(1, dtype=np.int64),
        inner_points=np.zeros((1, 3)),
        inner_normals=np.array([[0.0, 0.0, 1.0]]),
        adjacency=np.ones((2, 2), dtype=bool),
        link_grids=[small, small],
        link_vertices=[np.zeros((0, 3)), np.zeros((0, 3))],
        link_faces=[np.zeros((0, 3), np.int32), np.zeros((0, 3), np.int32)],
    )


def grasps_around(model: ObjectModel, count: int, seed: int = 0) -> GraspSet:
    """Palms 2 to 7 cm above random surface points, facing them; every tenth misses."""
    generator = np.random.default_rng(seed)
    chosen = generator.integers(len(model.surface_points), size=count)
    point, normal = model.surface_points[chosen], model.surface_normals[chosen]
    inside = -normal.astype(np.float64)
    side = np.cross(inside, generator.normal(size=(count, 3)))
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    hit = point.astype(np.float64)
    position = hit - generator.uniform(0.02, 0.07, (count, 1)) * inside
    hit[::10] = np.nan
    rotation = np.stack([side, np.cross(inside, side), inside], axis=2)
    joints = generator.uniform(-0.5, 0.5, (count, 1))
    scalars = generator.uniform(size=(4, count))
    return GraspSet(position, rotation, joints, model.id, "paddle", ["bend"], hit, *scalars)


def with_faces(model: ObjectModel, faces: np.ndarray) -> ObjectModel:
    return dataclasses.replace(model, id=f"{model.id}-other-faces", faces=faces)
