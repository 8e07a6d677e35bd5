"""Clouds and hands as small flat pieces, drawn from the farthest to the nearest: no OpenGL.

An orthographic view in plain axes hides what is behind, which scatter plots in 3-D do not.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_rgb
from scipy.spatial import ConvexHull, cKDTree

from dmfc.geometry import transforms
from dmfc.hand.kinematics import HandKinematics
from dmfc.hand.model import HandModel

AZIMUTH, ELEVATION = np.deg2rad(-50), np.deg2rad(35)
GRID = 0.1
"""Metres between the lines of the table."""
_LIGHT = np.array([0.75, -0.35, 0.85])
_TABLE, _LINES = "#f4f4f2", "#dcdcd8"


@dataclass(frozen=True)
class Pieces:
    """n flat quadrilaterals in the world; a triangle has its last corner twice."""

    corners: np.ndarray
    """[n, 4, 3] metres."""
    normals: np.ndarray
    """[n, 3] outward, unit length."""
    colours: np.ndarray
    """[n, 3] red, green, blue in 0..1."""

    def __add__(self, other: Pieces) -> Pieces:
        return Pieces(
            np.concatenate([self.corners, other.corners]),
            np.concatenate([self.normals, other.normals]),
            np.concatenate([self.colours, other.colours]),
        )


def cloud_pieces(points: np.ndarray, normals: np.ndarray, colours: np.ndarray) -> Pieces:
    """A square on the surface at every point [N, 3], about as wide as points lie apart."""
    points, normals = points.astype(np.float64), normals.astype(np.float64)
    spacing = cKDTree(points).query(points, 2)[0][:, 1]
    half = np.clip(1.5 * np.median(spacing), 0.0008, 0.004)
    helper = np.where(np.abs(normals[:, :1]) < 0.9, [[1.0, 0, 0]], [[0, 1.0, 0]])
    side = np.cross(normals, helper)
    side *= half / np.maximum(np.linalg.norm(side, axis=1, keepdims=True), 1e-9)
    other = np.cross(normals, side)
    corners = np.stack([side + other, side - other, -side - other, other - side], axis=1)
    return Pieces(points[:, None] + corners, normals, colours)


def hand_pieces(
    hand: HandModel, T_world_palm: np.ndarray, joints: np.ndarray, colour: str
) -> Pieces:
    """Hands at T_world_palm [n, 4, 4] with joints [n, D]: the convex hull of every link."""
    links = HandKinematics(hand).links(torch.as_tensor(T_world_palm), torch.as_tensor(joints))
    corners, normals = [], []
    for link in range(hand.links):
        points = hand.link_vertices[link]
        if len(points) == 0:
            points = hand.collision_points[hand.collision_link == link]
        if len(points) < 4:
            continue
        hull = ConvexHull(points, qhull_options="QJ")  # joggled: a flat link has a hull too
        for T_world_link in links[:, link].numpy():
            corners.append(transforms.apply(T_world_link, points[hull.simplices[:, [0, 1, 2, 2]]]))
            normals.append(transforms.rotate(T_world_link, hull.equations[:, :3]))
    found = np.concatenate(corners)
    return Pieces(found, np.concatenate(normals), np.tile(to_rgb(colour), (len(found), 1)))


def bounds(*parts: Pieces) -> np.ndarray:
    """[2, 2] lower and upper corner of what pieces cover in the picture, with a margin."""
    flat = np.concatenate([_project(part.corners)[0].reshape(-1, 2) for part in parts])
    return np.stack([flat.min(0) - 0.02, flat.max(0) + 0.02])


def draw(axes: Any, pieces: Pieces, window: np.ndarray, table_size: float) -> None:
    """Pieces that face the viewer, on the table with its lines, within `window` [2, 2]."""
    _table(axes, table_size)
    towards = _axes()[2]
    seen = np.flatnonzero(pieces.normals @ towards > 0)
    flat, depth = _project(pieces.corners[seen])
    order = np.argsort(depth.mean(1))
    light = np.clip(pieces.normals[seen] @ (_LIGHT / np.linalg.norm(_LIGHT)), 0, 1)
    colours = pieces.colours[seen] * (0.45 + 0.55 * light[:, None])
    polygons = PolyCollection(
        list(flat[order]), facecolors=colours[order], edgecolors=colours[order], linewidths=0.2
    )
    axes.add_collection(polygons)
    axes.set(xlim=window[:, 0], ylim=window[:, 1], aspect="equal")
    axes.set_axis_off()


def _table(axes: Any, size: float) -> None:
    half = size / 2
    corners = np.array([[-half, -half, 0], [half, -half, 0], [half, half, 0], [-half, half, 0]])
    axes.fill(*_project(corners)[0].T, color=_TABLE, zorder=0)
    for at in np.arange(-half, half + GRID / 2, GRID):
        for ends in ([[at, -half, 0], [at, half, 0]], [[-half, at, 0], [half, at, 0]]):
            axes.plot(*_project(np.array(ends))[0].T, color=_LINES, linewidth=0.6, zorder=0)


def _axes() -> np.ndarray:
    """[3, 3]: right, up and towards the viewer, world frame."""
    flat = np.array([np.cos(AZIMUTH), np.sin(AZIMUTH), 0.0])
    towards = np.cos(ELEVATION) * flat + np.array([0, 0, np.sin(ELEVATION)])
    right = np.array([-flat[1], flat[0], 0.0])
    return np.stack([right, np.cross(towards, right), towards])


def _project(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Places in the picture [..., 2], metres, and how near the viewer [...] points [..., 3] are."""
    seen = points @ _axes().T
    return seen[..., :2], seen[..., 2]
