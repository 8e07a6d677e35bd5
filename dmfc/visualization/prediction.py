"""A picture of predicted grasps: the dense field, and the most confident ones."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.art3d import Line3DCollection

from dmfc.hand.description import load_description
from dmfc.prediction.ranked import RankedGrasps
from dmfc.visualization.glyph import palm_glyphs


def grasp_picture(grasps: RankedGrasps, points: np.ndarray, path: Path, best: int = 5) -> None:
    """Write a PNG: all grasps coloured by confidence, and the `best` alone, with the cloud.

    `points` [N, 3]: the cloud in metres.
    """
    hand = load_description(grasps.hand)
    lines = palm_glyphs(
        grasps.T_cloud_palm, np.array(hand.palm_reference), np.array(hand.palm_normal)
    )
    figure = Figure(figsize=(12, 5.6), dpi=100, layout="constrained")
    FigureCanvasAgg(figure)
    box = np.concatenate([points, lines.reshape(-1, 3)])
    best = min(best, len(grasps))
    panels = [(len(grasps), f"{len(grasps)} grasps"), (best, f"the {best} most confident")]
    for place, (count, title) in enumerate(panels):
        axes: Any = figure.add_subplot(1, 2, place + 1, projection="3d")
        axes.scatter(*points[:: max(1, len(points) // 3000)].T, s=1, c="#b8b8b8", alpha=0.5)
        drawn = _draw(axes, lines[:count][::-1], grasps.confidence[:count][::-1], 1.0 + place)
        _frame(axes, box, title)
    figure.colorbar(drawn, ax=figure.axes, label="confidence", shrink=0.7)
    figure.savefig(path)


def _draw(axes: Any, lines: np.ndarray, confidence: np.ndarray, width: float) -> LineCollection:
    """The least confident first, so that the others lie over them."""
    drawn = Line3DCollection(list(lines), cmap="viridis", linewidths=width)
    drawn.set_array(confidence)
    drawn.set_clim(0, 1)
    axes.add_collection3d(drawn)
    return drawn


def _frame(axes: Any, points: np.ndarray, title: str) -> None:
    """A cube around the points, equal scales."""
    low, high = points.min(0), points.max(0)
    half, centre = (high - low).max() / 2, (low + high) / 2
    limits = zip(centre - half, centre + half, strict=True)
    for name, (start, stop) in zip("xyz", limits, strict=True):
        axes.set(**{f"{name}lim": (start, stop), f"{name}label": f"{name} (m)"})
    axes.set_box_aspect((1, 1, 1))
    axes.view_init(elev=25, azim=-60)
    axes.tick_params(labelsize=6)
    axes.set_title(title, fontsize=10, parse_math=False)
