"""Object models of simple shapes, built without the preparation stage, and grasps and a hand."""

from __future__ import annotations

from itertools import pairwise

import igl
import numpy as np
import trimesh
from dmfc.objects.model import ObjectModel

from dmfc.geometry.grid import Grid


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
    name: str, mesh: trimesh.Trimesh, parts: list[np.ndarray] | None = None
) -> ObjectModel:
    """ObjectModel of a watertight mesh; `parts` are its convex pieces (default: itself)."""
    vertices = np.array(mesh.vertices, dtype=np.float64)
    faces = np.array(mesh.faces, dtype=np.int32)

    def signed(points: np.ndarray) -> np.ndarray:
        return -igl.signed_distance(points, vertices, faces.astype(np.int64))[0]

    margin = 0.02
    grid = Grid.sample(signed, vertices.min(0) - margin, vertices.max(0) + margin, 0.003)
    samples, index = trimesh.sample.sample_surface(mesh, 2000, seed=0)
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
