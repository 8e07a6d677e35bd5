"""Mass, centre of mass and inertia, for a uniform density."""

from __future__ import annotations

import numpy as np
import trimesh
from scipy.spatial import ConvexHull

from dmfc.geometry.grid import Grid
from dmfc.objects.mesh import CleanMesh
from dmfc.objects.model import ObjectModel

ASSUMED = "mass from density"
"""How the note of an object without a known mass begins."""
_LIGHTEST, _HEAVIEST = 20.0, 23_000.0
"""kg per m^3 of convex hull: polystyrene foam; osmium."""


def mass_properties(
    mesh: CleanMesh, sdf: Grid, known_mass: float | None, density: float, max_mass: float
) -> tuple[float, np.ndarray, np.ndarray]:
    """(mass kg, centre of mass [3], inertia about it [3, 3] in object axes).

    A closed mesh is integrated exactly; an open one through the voxels inside it. Without a known
    mass it is density times volume, at most `max_mass`.
    """
    if mesh.closed:
        exact = mesh.trimesh
        volume, com, unit_inertia = float(exact.volume), exact.center_mass, exact.moment_inertia
    else:
        volume, com, unit_inertia = _voxel_properties(sdf)
    mass = known_mass if known_mass is not None else min(density * volume, max_mass)
    return float(mass), np.asarray(com, dtype=np.float64), _valid(unit_inertia * mass / volume)


def implausible_mass(model: ObjectModel) -> str:
    """A warning where an object is lighter than foam of its size or heavier than any metal, naming
    its mesh and density; '' where its mass can be."""
    hull = float(ConvexHull(model.vertices).volume)
    apparent = model.mass / hull
    if _LIGHTEST <= apparent <= _HEAVIEST:
        return ""
    volume = abs(float(trimesh.Trimesh(model.vertices, model.faces, process=False).volume))
    assumed = [note for note in model.notes if note.startswith(ASSUMED)]
    how = f"{assumed[0]}, and the walls of its mesh hold {1e6 * volume:.3g} cm^3" if assumed else ""
    return (
        f"{model.id}: a mass of {1000 * model.mass:.3g} g is implausible for an object that fills "
        f"{1e6 * hull:.3g} cm^3 ({how or 'as its source has it'}): setting "
        "objects.prepare.density, or a source that knows the mass"
    )


def _voxel_properties(sdf: Grid) -> tuple[float, np.ndarray, np.ndarray]:
    """(volume, centre, inertia for density 1) of the nodes with positive distance."""
    points = sdf.origin + sdf.spacing * np.argwhere(sdf.values > 0)
    com = points.mean(axis=0)
    offsets = points - com
    second = offsets.T @ offsets + np.eye(3) * len(points) * sdf.spacing**2 / 12
    cell = float(sdf.spacing**3)
    return len(points) * cell, com, (np.trace(second) * np.eye(3) - second) * cell


def _valid(inertia: np.ndarray) -> np.ndarray:
    """Symmetric, with principal moments that a body can have (positive, triangle inequality)."""
    moments, axes = np.linalg.eigh((inertia + inertia.T) / 2)
    moments = np.maximum(moments, 1e-3 * moments[2])
    # The second moments of mass along the axes must not be negative.
    second = np.maximum(moments.sum() / 2 - moments, 1e-4 * moments[2])
    return (axes * (second.sum() - second)) @ axes.T
