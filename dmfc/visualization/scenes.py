"""Pictures of one scene or of some: depth images, cloud, positive points, a few grasps."""

from __future__ import annotations

import io
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from PIL import Image

from dmfc.config.scenes import MatchingConfig
from dmfc.geometry.points import farthest_points
from dmfc.grasps.grasp_set import GraspSet
from dmfc.hand.model import HandModel
from dmfc.scenes.matching import match_grasps
from dmfc.scenes.scene_grasps import SceneGrasps, grasps_in_scene
from dmfc.scenes.scene_set import Scene
from dmfc.sensing.render import CameraView
from dmfc.visualization.drawing import Pieces, bounds, cloud_pieces, draw, hand_pieces

COLOURS = ["#4269d0", "#efb118", "#ff725c", "#3ca951", "#a463f2", "#97bbf5", "#9c6b4e"]
_GREY, _POSITIVE, _HAND = "#c8c8c8", "#d62728", "#e3c9ad"
_MARGIN = 16  # pixels around the objects of a depth image
_SHADES = 256  # colours of a PNG: a third of the bytes, and no difference to see

Panel = Callable[[Any], None]


def scene_picture(
    scene: Scene,
    path: Path,
    views: Sequence[CameraView] = (),
    grasps: Mapping[str, GraspSet] | None = None,
    hand: HandModel | None = None,
    matching: MatchingConfig | None = None,
    shown_grasps: int = 3,
    table_size: float = 0.8,
) -> None:
    """Write a picture of a scene as PNG: cloud by object, and seen from above with its normals.

    `views` adds a row of depth images (see `dmfc.scenes.views`); `grasps` and `hand` together add
    the positive points and `shown_grasps` labels, those whose palms lie farthest apart.
    """
    drawn = _Drawn.of(scene, grasps, hand, matching, shown_grasps, table_size)
    panels = [drawn.cloud, lambda axes: _plan(axes, scene), *drawn.labels()]
    rows = [[_depth_panel(view, n) for n, view in enumerate(views)], panels]
    _write(_sheet([row for row in rows if row], 3.4), path)


def contact_sheet(
    scenes: Sequence[Scene],
    views: Sequence[Sequence[CameraView]],
    path: Path | BinaryIO,
    grasps: Mapping[str, GraspSet] | None = None,
    hand: HandModel | None = None,
    matching: MatchingConfig | None = None,
    table_size: float = 0.8,
) -> None:
    """Write a PNG with a row per scene: two depth images (of `views`, which may be empty for a
    scene), the cloud, and with `grasps` and `hand` the positive points and three labels."""
    rows = []
    for scene, seen in zip(scenes, views, strict=True):
        drawn = _Drawn.of(scene, grasps, hand, matching, 3, table_size)
        depth = [_depth_panel(view, n) for n, view in enumerate(seen[:2])]
        rows.append([*depth, drawn.cloud, *drawn.labels()])
    _write(_sheet(rows, 2.7), path)


def _sheet(rows: Sequence[Sequence[Panel]], size: float) -> Figure:
    """Panels in rows, each `size` inches wide."""
    columns = max(len(row) for row in rows)
    height = 0.92 * size * len(rows)
    figure = Figure(figsize=(size * columns, height), dpi=100)
    room = 0.25 / height  # for what is written below the last row
    pads = {"w_pad": 0.02, "h_pad": 0.02, "wspace": 0.01, "hspace": 0.01}
    figure.set_layout_engine("constrained", rect=(0, room, 1, 1 - room), **pads)
    FigureCanvasAgg(figure)
    for number, row in enumerate(rows):
        for column, panel in enumerate(row):
            panel(figure.add_subplot(len(rows), columns, number * columns + column + 1))
    return figure


def _write(figure: Figure, path: Path | BinaryIO) -> None:
    whole = io.BytesIO()
    figure.savefig(whole)
    with Image.open(whole) as picture:
        picture.convert("RGB").quantize(_SHADES).save(path, format="PNG", optimize=True)


@dataclass(frozen=True)
class _Drawn:
    """The panels of one scene that share a window."""

    scene: Scene
    grasps: SceneGrasps | None
    positive: np.ndarray
    """[N] bool: which points have a grasp."""
    hands: Pieces | None
    shown: int
    window: np.ndarray
    table_size: float

    @classmethod
    def of(
        cls,
        scene: Scene,
        grasps: Mapping[str, GraspSet] | None,
        hand: HandModel | None,
        matching: MatchingConfig | None,
        shown: int,
        table_size: float,
    ) -> _Drawn:
        in_world = hands = None
        positive = np.zeros(len(scene.points), dtype=bool)
        if grasps is not None and hand is not None:
            in_world = _labels(scene, grasps, hand.palm_reference)
            positive = np.any(match_grasps(matching or MatchingConfig(), scene, in_world), axis=1)
            shown = min(shown, len(in_world))
            if shown:
                chosen = farthest_points(in_world.position, shown)
                T_world_palm = in_world[chosen].T
                hands = hand_pieces(hand, T_world_palm, in_world.joints[chosen], _HAND)
        parts = [_cloud(scene, _colours(scene)), *([hands] if hands else [])]
        return cls(scene, in_world, positive, hands, shown, bounds(*parts), table_size)

    def cloud(self, axes: Any) -> None:
        self._draw(axes, _cloud(self.scene, _colours(self.scene)))
        axes.set_title(f"scene {self.scene.scene}: {len(self.scene.points)} points", fontsize=8)
        _names(axes, self.scene)

    def labels(self) -> list[Panel]:
        """The panels of positive points and of hands; none for a scene without grasp sets."""
        return [] if self.grasps is None else [self._positive_points, self._hands]

    def _positive_points(self, axes: Any) -> None:
        assert self.grasps is not None
        colours = np.where(self.positive[:, None], to_rgb(_POSITIVE), to_rgb(_GREY))
        self._draw(axes, _cloud(self.scene, colours))
        share, count = self.positive.mean(), len(self.grasps.position)
        axes.set_title(f"positive points: {share:.0%}, of {count} labels", fontsize=8)

    def _hands(self, axes: Any) -> None:
        pieces = _cloud(self.scene, _colours(self.scene))
        self._draw(axes, pieces + self.hands if self.hands else pieces)
        axes.set_title(f"{self.shown} of the labels", fontsize=8)
        dropped = ", ".join(f"{n} {reason}" for reason, n in self.scene.dropped.items() if n)
        _below(axes, 0, 0, f"dropped: {dropped or 'none'}", "#555555")

    def _draw(self, axes: Any, pieces: Pieces) -> None:
        draw(axes, pieces, self.window, self.table_size)


def _cloud(scene: Scene, colours: np.ndarray) -> Pieces:
    return cloud_pieces(scene.points, scene.normals, colours)


def _names(axes: Any, scene: Scene) -> None:
    """The objects' names in their colours, below."""
    for index, name in enumerate(scene.object_ids):
        colour = COLOURS[index % len(COLOURS)]
        _below(axes, index // 3, index % 3, name.split("/", 1)[-1], colour)


def _below(axes: Any, line: int, column: int, text: str, colour: str) -> None:
    """Small print under a panel, in three columns."""
    place = 0.01 + 0.35 * column, -0.02 - 0.07 * line
    axes.text(*place, text, transform=axes.transAxes, color=colour, fontsize=7, va="top")


def _labels(
    scene: Scene, grasps: Mapping[str, GraspSet], palm_reference: np.ndarray
) -> SceneGrasps:
    labels = (scene.grasp_object, scene.grasp_index)
    return grasps_in_scene(scene.object_ids, scene.T_world_object, *labels, grasps, palm_reference)


def _colours(scene: Scene) -> np.ndarray:
    return np.array([to_rgb(COLOURS[k % len(COLOURS)]) for k in scene.point_object])


def _depth_panel(view: CameraView, number: int) -> Panel:
    return lambda axes: _depth_image(axes, view, number)


def _depth_image(axes: Any, view: CameraView, number: int) -> None:
    """The part of the image around the objects, which are outlined."""
    is_object = view.object_index >= 0
    where = np.argwhere(is_object)
    if len(where):
        low = np.maximum(where.min(0) - _MARGIN, 0)
        rows, columns = (slice(a, b + _MARGIN) for a, b in zip(low, where.max(0), strict=True))
    else:
        rows = columns = slice(None)
    depth = np.where(view.depth > 0, view.depth, np.nan)[rows, columns]
    axes.imshow(depth, cmap="viridis_r")
    if len(where):
        outline = is_object[rows, columns].astype(float)
        axes.contour(outline, levels=[0.5], colors="white", linewidths=0.7)
    near, far = np.nanmin(depth), np.nanmax(depth)
    axes.set_title(f"camera {number}: {near:.2f} to {far:.2f} m", fontsize=8)
    axes.set_axis_off()


def _plan(axes: Any, scene: Scene) -> None:
    """From above, with the normals of every eighth point and the objects' names."""
    points, normals = scene.points, scene.normals
    axes.scatter(points[:, 0], points[:, 1], c=_colours(scene), s=2)
    some = slice(None, None, 8)
    axes.quiver(*points[some, :2].T, *normals[some, :2].T, color="#555555", width=0.002, scale=25)
    for index, name in enumerate(scene.object_ids):
        mine = scene.point_object == index
        if mine.any():
            axes.annotate(name, points[mine, :2].mean(0), fontsize=7, ha="center")
    axes.set_aspect("equal")
    axes.set_title("from above, with normals", fontsize=9)
    axes.tick_params(labelsize=6)
