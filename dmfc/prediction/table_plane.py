"""Finds a table that was left in a cloud: a plane below everything else that reaches beyond it."""

from __future__ import annotations

import numpy as np

THICKNESS = 0.004
"""Metres from the plane within which a point lies on it: three times a depth camera's noise."""
TILT = np.cos(np.radians(20))
"""A table's normal is within 20 degrees of up."""
SHARE = 0.35
"""Of all points, at least so many lie on it."""
BELOW = 0.02
"""Of all points, at most so many lie below it."""
REACH = 1.5
"""Its bounding rectangle has at least this many times the area of that of the points above it."""
ALONE = 0.3
"""Metres: without anything above it, a plane with sides longer than this is a table."""
TRIALS, LOOKED_AT = 256, 4000


def find_table(points: np.ndarray, up: np.ndarray) -> np.ndarray | None:
    """Mask [n] of the points of a table in `points` [n, 3] (metres), those below it included.

    None where there is none. RANSAC with a fixed seed, so the same cloud gives the same answer:
    planes through three points whose normal is within `TILT` of the unit vector `up` [3].
    """
    plane = _best_plane(points, up)
    if plane is None:
        return None
    normal, offset = plane
    height = points @ normal - offset
    table = height < THICKNESS
    on_it, above = table & (height > -THICKNESS), ~table
    if on_it.mean() < SHARE or (height <= -THICKNESS).mean() > BELOW:
        return None
    flat = points @ _across(up)
    sides = np.ptp(flat[on_it], axis=0)
    if above.mean() < BELOW:
        return table if sides.min() > ALONE else None
    return table if sides.prod() > REACH * np.ptp(flat[above], axis=0).prod() else None


def _best_plane(points: np.ndarray, up: np.ndarray) -> tuple[np.ndarray, float] | None:
    """Unit normal (upwards) and offset of the plane with the most points, fitted to them."""
    generator = np.random.default_rng(0)
    some = points
    if len(points) > LOOKED_AT:
        some = points[generator.choice(len(points), LOOKED_AT, replace=False)]
    corners = some[generator.integers(len(some), size=(TRIALS, 3))]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(normals, axis=1)
    upright = np.abs(normals @ up) > TILT * np.maximum(length, 1e-12)
    if not upright.any():
        return None
    normals = normals[upright] / length[upright, None]
    normals *= np.sign(normals @ up)[:, None]
    offsets = (normals * corners[upright, 0]).sum(1)
    near = np.abs(some @ normals.T - offsets) < THICKNESS
    best = int(near.sum(0).argmax())
    inliers = some[near[:, best]]
    centre = inliers.mean(0)
    normal = np.linalg.svd(inliers - centre, full_matrices=False)[2][-1]
    normal *= np.sign(normal @ up)
    return normal, float(normal @ centre)


def _across(up: np.ndarray) -> np.ndarray:
    """Two unit vectors [3, 2] at right angles to `up` and to each other."""
    return np.linalg.svd(up[None])[2][1:].T
