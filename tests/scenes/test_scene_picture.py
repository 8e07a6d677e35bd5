"""The contact sheet is a picture with something on it."""

from __future__ import annotations

import numpy as np
from matplotlib.image import imread

from dmfc.config.scenes import MatchingConfig
from dmfc.scenes.make import SceneMaker
from dmfc.scenes.picture import scene_picture


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
