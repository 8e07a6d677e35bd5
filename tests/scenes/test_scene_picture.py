"""The contact sheet is a picture with something on it."""

from __future__ import annotations

import dataclasses

import numpy as np
import torch
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.image import imread

from dmfc.config.scenes import MatchingConfig
from dmfc.hand.kinematics import HandKinematics
from dmfc.scenes.make import SceneMaker
from dmfc.visualization import drawing
from dmfc.visualization.scenes import scene_picture


def test_contact_sheet(tmp_path, scenes, objects, grasps, hand, config):
    scene = scenes[0]
    with SceneMaker(config, config.train, objects) as maker:
        views = maker.views([objects[name] for name in scene.object_ids], scene.T_world_object)
    path = tmp_path / "scene.png"
    scene_picture(scene, path, views, grasps, hand, MatchingConfig(distance=0.01))
    picture = imread(path)
    assert picture.shape[1] > picture.shape[0] > 400
    bands = np.split(picture[:, : picture.shape[1] // 4 * 4, :3], 4, axis=1)
    assert all(band.std() > 0.05 for band in bands)


def test_scene_without_labels_or_views(tmp_path, scenes):
    scene_picture(scenes[0], tmp_path / "scene.png")
    assert (tmp_path / "scene.png").stat().st_size > 10_000


def test_what_is_in_front_hides_what_is_behind():
    """Two walls, a red one nearer to the viewer: no blue is left, in whichever order they come."""
    across, _, towards = drawing._axes()
    grid = np.linspace(-0.05, 0.05, 30)
    wall = (grid[:, None, None] * across + grid[:, None] * [0, 0, 1]).reshape(-1, 3)
    normals = np.tile(towards, (len(wall), 1))
    blue, red = (np.tile(colour, (len(wall), 1)) for colour in ([0, 0, 1.0], [1.0, 0, 0]))
    back = drawing.cloud_pieces(wall, normals, blue)
    front = drawing.cloud_pieces(wall + 0.1 * towards, normals, red)
    for pieces in (back + front, front + back):
        found = _pixels(pieces, drawing.bounds(back))
        assert (found[..., 0] > found[..., 2] + 0.2).sum() > 1000
        assert (found[..., 2] > found[..., 0] + 0.2).sum() == 0
    turned = dataclasses.replace(front, normals=-front.normals)  # seen from behind: not drawn
    found = _pixels(turned, drawing.bounds(back))
    assert (found[..., 0] > found[..., 2] + 0.2).sum() == 0


def _pixels(pieces, window):
    figure = Figure(figsize=(2, 2), dpi=80)
    canvas = FigureCanvasAgg(figure)
    drawing.draw(figure.add_axes((0, 0, 1, 1)), pieces, window, 0.8)
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())[..., :3] / 255.0


def test_a_drawn_hand_is_around_its_collision_points(hand):
    T_world_palm = np.eye(4)[None].copy()
    T_world_palm[0, :3, 3] = [0.1, 0.2, 0.3]
    pieces = drawing.hand_pieces(hand, T_world_palm, np.array([[0.4]]), "#ff0000")
    points = HandKinematics(hand).collision_points(
        torch.as_tensor(T_world_palm), torch.tensor([[0.4]], dtype=torch.float64)
    )[0]
    corners = pieces.corners.reshape(-1, 3)
    assert np.allclose(corners.min(0), points.numpy().min(0), atol=1e-4)
    assert np.allclose(corners.max(0), points.numpy().max(0), atol=1e-4)
    assert (pieces.colours == [1, 0, 0]).all()
