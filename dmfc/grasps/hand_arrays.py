"""A hand and a distance grid as the plain arrays that the compiled loops of the planner read.

The points on a link are grouped into clusters of neighbours, each with a bounding sphere, so that
the loops can skip most of them.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dmfc.geometry.grid import Grid
from dmfc.hand.model import HandModel

_CLUSTER = 12
"""Points of a cluster, at most."""


class HandArrays(NamedTuple):
    """A hand of L links, D degrees of freedom and P points on its surface, in C clusters."""

    parents: np.ndarray
    T_parent_link: np.ndarray
    axis: np.ndarray
    dof: np.ndarray
    scale: np.ndarray
    first: np.ndarray
    """[C + 1] the points of cluster c are first[c]:first[c + 1]."""
    points: np.ndarray
    """[P, 3] link frames."""
    centre: np.ndarray
    """[C, 3] of a sphere around the points of a cluster, link frame."""
    radius: np.ndarray
    """[C] of that sphere."""
    clusters: np.ndarray
    """[L + 1] the clusters of link l are clusters[l]:clusters[l + 1]."""
    link_centre: np.ndarray
    """[L, 3] of a sphere around the points of a link, link frame."""
    link_radius: np.ndarray
    """[L] of that sphere; negative where a link has no points."""
    finger: np.ndarray
    """[L] finger of each link, -1 for the palm."""
    flexion: np.ndarray
    lower: np.ndarray
    upper: np.ndarray


class GridArrays(NamedTuple):
    """A distance grid."""

    values: np.ndarray
    origin: np.ndarray
    spacing: float


def hand_arrays(hand: HandModel, finger_of_link: np.ndarray) -> HandArrays:
    """The arrays of a hand; finger_of_link [L]."""
    points = np.asarray(hand.collision_points, dtype=np.float64)
    rows = [np.flatnonzero(hand.collision_link == link) for link in range(hand.links)]
    split = [_clusters(points, of_link) for of_link in rows]
    flat = [cluster for of_link in split for cluster in of_link]
    spheres = (*_spheres([points[c] for c in flat]), np.cumsum([0, *map(len, split)]))
    link_spheres = _spheres([points[of_link] for of_link in rows])
    first = np.cumsum([0, *map(len, flat)])
    points = np.ascontiguousarray(points[np.concatenate(flat)])
    real = [hand.T_parent_link, hand.joint_axis, hand.joint_scale]
    T, axis, scale = (np.ascontiguousarray(array, dtype=np.float64) for array in real)
    limits = [np.asarray(array, dtype=np.float64) for array in (hand.lower, hand.upper)]
    flexion = np.asarray(hand.flexion, dtype=np.float64)
    tree = (hand.parents.astype(np.int64), T, axis, hand.joint_dof.astype(np.int64), scale)
    surface = (first, points, *spheres, *link_spheres)
    return HandArrays(*tree, *surface, finger_of_link, flexion, *limits)


def _clusters(points: np.ndarray, rows: np.ndarray) -> list[np.ndarray]:
    """Rows of the points, halved along their longest side until they are few enough."""
    if len(rows) <= _CLUSTER:
        return [rows] if len(rows) else []
    side = np.argmax(np.ptp(points[rows], axis=0))
    rows = rows[np.argsort(points[rows, side], kind="stable")]
    half = len(rows) // 2
    return _clusters(points, rows[:half]) + _clusters(points, rows[half:])


def _spheres(groups: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Centres [n, 3] and radii [n] around groups of points; -1 around none."""
    centre, radius = np.zeros((len(groups), 3)), np.full(len(groups), -1.0)
    for row, group in enumerate(groups):
        if len(group):
            centre[row] = 0.5 * (group.min(axis=0) + group.max(axis=0))
            radius[row] = np.linalg.norm(group - centre[row], axis=1).max()
    return centre, radius


def grid_arrays(grid: Grid) -> GridArrays:
    """The arrays of a grid."""
    return GridArrays(grid.values, grid.origin, grid.spacing)
