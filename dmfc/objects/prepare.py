"""Prepare an object: from a source's mesh to an `ObjectModel`."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from dmfc.config.objects import PrepareConfig
from dmfc.objects.convex import convex_parts
from dmfc.objects.mass import ASSUMED, mass_properties
from dmfc.objects.mesh import CleanMesh, clean
from dmfc.objects.model import ObjectModel
from dmfc.objects.poses import stable_poses
from dmfc.objects.sdf import signed_distance_grid
from dmfc.objects.source import ObjectSource
from dmfc.objects.sources import find_object


def prepare(source: ObjectSource, config: PrepareConfig) -> ObjectModel:
    """Everything that is computed once per object; a function of its arguments alone.

    Raises DmfcError with the object's id if its mesh is missing, broken or without volume.
    """
    mesh = clean(source.load(), source.id)
    sdf = signed_distance_grid(
        mesh.vertices,
        mesh.faces,
        mesh.closed,
        config.sdf_spacing,
        config.sdf_margin,
        config.sdf_max_voxels,
    )
    mass, com, inertia = mass_properties(mesh, sdf, source.mass, config.density, config.max_mass)
    parts = convex_parts(mesh, config)
    poses = stable_poses(mesh.vertices, parts, com, config.stable_poses)
    points, normals = surface_samples(mesh, config.surface_points)
    assumed = [] if source.mass is not None else [f"{ASSUMED} {config.density:g} kg/m^3"]
    return ObjectModel(
        id=source.id,
        vertices=mesh.vertices,
        faces=mesh.faces,
        watertight=mesh.watertight,
        mass=mass,
        com=com,
        inertia=inertia,
        convex_parts=parts,
        sdf=sdf,
        surface_points=points,
        surface_normals=normals,
        stable_rotations=poses.rotations,
        stable_heights=poses.heights,
        stable_probabilities=poses.probabilities,
        standard_pose=poses.standard,
        source=source.source,
        licence=source.licence,
        mesh_sha256=mesh.sha256,
        notes=mesh.notes + assumed,
    )


def prepare_to(selector: str, config: PrepareConfig, out_path: str | os.PathLike[str]) -> None:
    """Prepare the one object of a selector or id ("ycb:mug", "ycb/mug") and write its file."""
    prepare(find_object(selector), config).save(Path(out_path))


def surface_samples(mesh: CleanMesh, count: int) -> tuple[np.ndarray, np.ndarray]:
    """(points [count, 3], outward unit normals [count, 3]) float32, even in area.

    Stratified by area, so that no patch is missed; the seed is fixed.
    """
    triangles = mesh.vertices[mesh.faces]
    scaled = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    doubled = np.linalg.norm(scaled, axis=1)
    cumulative = np.cumsum(doubled)
    rng = np.random.default_rng(0)
    place = (np.arange(count) + rng.random(count)) / count * cumulative[-1]
    face = np.minimum(np.searchsorted(cumulative, place), len(doubled) - 1)
    s, t = rng.random((2, count, 1))
    over = s + t > 1
    s, t = np.where(over, 1 - s, s), np.where(over, 1 - t, t)
    first, second, third = np.moveaxis(triangles[face], 1, 0)
    points = first + s * (second - first) + t * (third - first)
    normals = scaled[face] / doubled[face, None]
    return points.astype(np.float32), normals.astype(np.float32)
