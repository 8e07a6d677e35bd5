"""The dense picture, as the paper's Figure 1: every proposed grasp of a scene on its cloud."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import torch
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.art3d import Line3DCollection

from dmfc.execution.candidates import GraspCandidates
from dmfc.geometry.transforms import transform
from dmfc.hand.kinematics import HandKinematics
from dmfc.hand.model import HandModel

COLOURS = "viridis"
"""Colour map of the confidences, from 0 to the greatest."""


def dense_picture(
    points: np.ndarray,
    proposed: GraspCandidates,
    executed: GraspCandidates,
    hand: HandModel,
    path: Path,
    title: str,
) -> None:
    """Write a PNG: the cloud [N, 3] with all grasps as skeletons, then with those executed alone.

    Colour is confidence; the most confident are drawn last.
    """
    figure = Figure(figsize=(14, 6.5), dpi=110, layout="constrained")
    FigureCanvasAgg(figure)
    scale = Normalize(0.0, max(0.01, float(proposed.confidence.max(initial=0.0))))
    panels: list[Any] = []
    titles = f"{title}: {len(proposed)} grasps", f"the {len(executed)} that are executed"
    for place, (grasps, text) in enumerate(zip((proposed, executed), titles, strict=True), start=1):
        axes: Any = figure.add_subplot(1, 2, place, projection="3d", computed_zorder=False)
        axes.scatter(*points.T, c="#555555", s=1.5, depthshade=False, zorder=1)
        if len(grasps):
            _draw(axes, grasps, hand, scale, dim=len(grasps) > 20)
        axes.set_title(text, fontsize=11, parse_math=False)
        _frame(axes, points)
        panels.append(axes)
    colours = ScalarMappable(scale, COLOURS)
    figure.colorbar(colours, ax=panels, shrink=0.6, label="confidence")
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path)


def skeletons(grasps: GraspCandidates, hand: HandModel) -> np.ndarray:
    """Lines [n, s, 2, 3] in the world: from each link's origin to its parent's, and to the tips."""
    T_world_palm = torch.as_tensor(transform(grasps.rotation, grasps.position))
    T = HandKinematics(hand).links(T_world_palm, torch.as_tensor(grasps.joints)).numpy()
    origins = T[..., :3, 3]
    children = np.flatnonzero(hand.parents >= 0)
    bones = np.stack([origins[:, hand.parents[children]], origins[:, children]], axis=2)
    leaves, tips = _tips(hand)
    ends = np.einsum("nlij,lj->nli", T[:, leaves, :3, :3], tips) + origins[:, leaves]
    return np.concatenate([bones, np.stack([origins[:, leaves], ends], axis=2)], axis=1)


def _tips(hand: HandModel) -> tuple[np.ndarray, np.ndarray]:
    """Links without children [t], and the collision point of each farthest from its origin [t, 3]
    in the link's frame."""
    leaves = np.setdiff1d(np.arange(hand.links), hand.parents)
    tips = np.zeros((len(leaves), 3))
    for row, link in enumerate(leaves):
        points = hand.collision_points[hand.collision_link == link]
        if len(points):
            tips[row] = points[np.argmax(np.linalg.norm(points, axis=1))]
    return leaves, tips


def _draw(axes: Any, grasps: GraspCandidates, hand: HandModel, scale: Normalize, dim: bool) -> None:
    grasps = grasps[np.argsort(grasps.confidence, kind="stable")]
    style = {"linewidths": 0.4, "alpha": 0.3} if dim else {"linewidths": 1.6}
    lines = skeletons(grasps, hand)
    colours = ScalarMappable(scale, COLOURS).to_rgba(np.repeat(grasps.confidence, lines.shape[1]))
    axes.add_collection3d(
        Line3DCollection(lines.reshape(-1, 2, 3), colors=colours, zorder=2, **style)
    )


def _frame(axes: Any, points: np.ndarray) -> None:
    """A cube around the cloud with room for hands; equal scales."""
    low, high = points.min(0), points.max(0)
    half = max(float((high - low).max()) / 2, 0.05) + 0.08
    x, y = ((low + high) / 2)[:2]
    axes.set(xlim=(x - half, x + half), ylim=(y - half, y + half), zlim=(0, 2 * half))
    axes.set_box_aspect((1, 1, 1), zoom=0.95)
    axes.view_init(elev=25, azim=-50)
    axes.tick_params(labelsize=6)
