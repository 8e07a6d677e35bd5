"""Contact sheets of one scene or of some: depth images, cloud, positive points, a few grasps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import torch
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure

from dmfc.config.scenes import MatchingConfig
from dmfc.geometry.transforms import transform
from dmfc.grasps.grasp_set import GraspSet
from dmfc.hand.kinematics import HandKinematics
from dmfc.hand.model import HandModel
from dmfc.scenes.carry import SceneGrasps, grasps_in_scene
from dmfc.scenes.matching import match_grasps
from dmfc.scenes.render import View
from dmfc.scenes.scene_set import Scene

COLOURS = ["#4269d0", "#efb118", "#ff725c", "#3ca951", "#a463f2", "#97bbf5", "#9c6b4e"]
_GREY = "#b8b8b8"


def scene_picture(
    scene: Scene,
    path: Path,
    views: Sequence[View] = (),
    grasps: Mapping[str, GraspSet] | None = None,
    hand: HandModel | None = None,
    matching: MatchingConfig | None = None,
    shown_grasps: int = 3,
) -> None:
    """Write the contact sheet of a scene as PNG.

    `views` adds a row of depth images (see `dmfc.scenes.views`); `grasps` and `hand` together add
    the positive points and `shown_grasps` labels, spread over the objects.
    """
    rows = 2 if views else 1
    figure = _figure(16, 4.2 * rows)
    for number, view in enumerate(views):
        _depth_image(figure.add_subplot(rows, 4, number + 1), view, number)
    first = 4 * (rows - 1) + 1
    _cloud(figure, (rows, 4, first), scene)
    _plan(figure.add_subplot(rows, 4, first + 1), scene)
    if grasps is not None and hand is not None:
        own = _labels(scene, grasps, hand.palm_reference)
        _positive_points(figure, (rows, 4, first + 2), scene, own, matching)
        _hands(figure, (rows, 4, first + 3), scene, own, hand, shown_grasps)
    figure.savefig(path)


def contact_sheet(
    scenes: Sequence[Scene],
    views: Sequence[Sequence[View]],
    path: Path | BinaryIO,
    grasps: Mapping[str, GraspSet] | None = None,
    hand: HandModel | None = None,
    matching: MatchingConfig | None = None,
) -> None:
    """Write a PNG with a row per scene: two depth images (of `views`, which may be empty for a
    scene), the cloud, and with `grasps` and `hand` the positive points and three labels."""
    rows, columns = len(scenes), 5
    figure = _figure(18, 3.6 * rows)
    for row, (scene, seen) in enumerate(zip(scenes, views, strict=True)):
        first = row * columns + 1
        for place, number in enumerate((0, 1)[: len(seen)]):
            axes = figure.add_subplot(rows, columns, first + place)
            _depth_image(axes, seen[number], number)
        _cloud(figure, (rows, columns, first + 2), scene)
        if grasps is not None and hand is not None:
            own = _labels(scene, grasps, hand.palm_reference)
            _positive_points(figure, (rows, columns, first + 3), scene, own, matching)
            _hands(figure, (rows, columns, first + 4), scene, own, hand, 3)
    figure.savefig(path)


def _figure(width: float, height: float) -> Figure:
    """An empty figure of that size in inches, drawn without a screen."""
    figure = Figure(figsize=(width, height), dpi=80, layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def _labels(
    scene: Scene, grasps: Mapping[str, GraspSet], palm_reference: np.ndarray
) -> SceneGrasps:
    labels = (scene.grasp_object, scene.grasp_index)
    return grasps_in_scene(scene.object_ids, scene.T_world_object, *labels, grasps, palm_reference)


def _colours(scene: Scene) -> np.ndarray:
    return np.array([to_rgb(COLOURS[k % len(COLOURS)]) for k in scene.point_object])


def _cloud(figure: Figure, place: tuple[int, int, int], scene: Scene) -> None:
    panel = _space(figure, place, f"scene {scene.scene}: {len(scene.points)} points", scene)
    panel.scatter(*scene.points.T, c=_colours(scene), s=2)


def _positive_points(
    figure: Figure,
    place: tuple[int, int, int],
    scene: Scene,
    own: SceneGrasps,
    matching: MatchingConfig | None,
) -> None:
    positive = _positive(scene, own, matching or MatchingConfig())
    title = f"positive points: {positive.mean():.1%}, {len(own.position)} labels"
    panel = _space(figure, place, title, scene)
    panel.scatter(*scene.points[~positive].T, c=_GREY, s=1, alpha=0.4)
    panel.scatter(*scene.points[positive].T, c="#d62728", s=4)


def _hands(
    figure: Figure,
    place: tuple[int, int, int],
    scene: Scene,
    own: SceneGrasps,
    hand: HandModel,
    shown: int,
) -> None:
    panel = _space(figure, place, f"{min(shown, len(own.position))} of the labels", scene)
    panel.scatter(*scene.points.T, c=_colours(scene), s=1, alpha=0.5)
    _draw_hands(panel, own, hand, shown)


def _depth_image(axes: Any, view: View, number: int) -> None:
    depth = np.where(view.depth > 0, view.depth, np.nan)
    axes.imshow(depth, cmap="viridis_r")
    outline = (view.object_index >= 0).astype(float)
    if outline.any():
        axes.contour(outline, levels=[0.5], colors="white", linewidths=0.8)
    near, far = np.nanmin(depth), np.nanmax(depth)
    axes.set_title(f"camera {number}: {near:.2f} to {far:.2f} m", fontsize=9)
    axes.set_axis_off()


def _space(figure: Figure, place: tuple[int, int, int], title: str, scene: Scene) -> Any:
    """A cube around the cloud with room for hands, standing on the table; equal scales."""
    axes: Any = figure.add_subplot(*place, projection="3d")
    axes.set_title(title, fontsize=9)
    low, high = scene.points.min(0), scene.points.max(0)
    half = max(float((high - low).max()) / 2, 0.05) + 0.04
    x, y = ((low + high) / 2)[:2]
    axes.set(xlim=(x - half, x + half), ylim=(y - half, y + half), zlim=(0, 1.6 * half))
    axes.set_box_aspect((5, 5, 4), zoom=1.3)
    axes.view_init(elev=30, azim=-50)
    axes.tick_params(labelsize=6)
    return axes


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


def _positive(scene: Scene, own: SceneGrasps, matching: MatchingConfig) -> np.ndarray:
    """Which points have a grasp, bool [N]."""
    matched = match_grasps(
        matching,
        scene.points,
        scene.normals,
        scene.point_object,
        own.palm_reference,
        own.palm_hit,
        own.object_index,
    )
    return np.asarray(matched.any(1))


def _draw_hands(axes: Any, own: SceneGrasps, hand: HandModel, shown: int) -> None:
    """The hand's collision points at a few labels, and a line from palm reference to palm hit."""
    if len(own.position) == 0:
        return
    chosen = np.unique(np.linspace(0, len(own.position) - 1, shown).round().astype(int))
    T_world_palm = torch.as_tensor(transform(own.rotation[chosen], own.position[chosen]))
    joints = torch.as_tensor(own.joints[chosen])
    hands = HandKinematics(hand).collision_points(T_world_palm, joints).numpy()
    for number, (points, grasp) in enumerate(zip(hands, chosen, strict=True)):
        colour = ["#333333", "#8c564b", "#17becf"][number % 3]
        axes.scatter(*points[::2].T, c=colour, s=0.6, alpha=0.6)
        line = np.stack([own.palm_reference[grasp], own.palm_hit[grasp]])
        if np.isfinite(line).all():
            axes.plot(*line.T, c="#d62728", linewidth=1.5)
