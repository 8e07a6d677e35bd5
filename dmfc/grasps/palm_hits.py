"""Where the palm of a grasp points at its object."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from dmfc.objects.model import ObjectModel


def palm_hits(
    model: ObjectModel, reference: np.ndarray, direction: np.ndarray, reach: float
) -> np.ndarray:
    """Where rays [n, 3] x 2 (object frame, unit directions) first meet the surface, [n, 3].

    A ray that passes the object within `reach` metres is given the surface point nearest to it, and
    NaN if it passes farther off. Sphere tracing in the signed-distance grid: a step as long as the
    distance cannot overshoot.
    """
    travelled = np.zeros(len(reference))
    best, best_gap = np.zeros(len(reference)), np.full(len(reference), np.inf)
    for _ in range(200):
        points = reference + travelled[:, None] * direction
        gap = np.maximum(-model.sdf.distance(points), 0.0)
        closer = gap < best_gap
        best[closer], best_gap[closer] = travelled[closer], gap[closer]
        # Beyond the grid its distance may be too long by twice the way to the grid.
        beyond = points - np.clip(points, model.sdf.origin, model.sdf.upper)
        to_grid = np.linalg.norm(beyond, axis=1)
        step = np.maximum(gap - 2 * to_grid, to_grid)
        travelled += np.maximum(step, 0.0005) * (gap > 0.0)
    hits = reference + best[:, None] * direction
    beside = best_gap > 0.0005
    if beside.any():
        rows = cKDTree(model.surface_points).query(hits[beside])[1]
        hits[beside] = model.surface_points[rows]
    hits[best_gap > reach] = np.nan
    return hits
