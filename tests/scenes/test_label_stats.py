"""Labels of scenes of one object: the same counts as matching gives, scene by scene."""

from __future__ import annotations

import numpy as np
import pytest

from dmfc.config.scenes import CameraConfig, MatchingConfig, ScenesConfig
from dmfc.geometry.points import farthest_points
from dmfc.scenes.matching import ObservedPoints, match_grasps
from dmfc.scenes.publish.label_stats import label_row, single_scenes
from dmfc.scenes.scene_grasps import grasps_in_scene


def test_shares_are_those_of_the_seeds(objects, grasps, hand):
    config = ScenesConfig(cameras=CameraConfig(width=160, height=120))
    names = ["shape/box", "shape/cup"]
    made = single_scenes(config, {n: objects[n] for n in names}, grasps, hand, 2)
    assert list(made) == names
    assert [scene.object_ids for scene in made["shape/cup"]] == [["shape/cup"]] * 2
    matching = MatchingConfig()
    row = label_row(made["shape/box"], grasps, hand, matching, 256)
    positive, matched, labels = [], 0, 0
    for scene in made["shape/box"]:
        in_world = grasps_in_scene(
            scene.object_ids,
            scene.T_world_object,
            scene.grasp_object,
            scene.grasp_index,
            grasps,
            hand.palm_reference,
        )
        seeds = farthest_points(scene.points, 256)
        table = match_grasps(matching, ObservedPoints.of(scene, seeds), in_world)
        positive.append(table.any(1).mean())
        matched, labels = matched + table.any(0).sum(), labels + table.shape[1]
    assert labels > 0
    assert row["labels_per_scene"] == labels / 2
    assert row["patch_positive"] == pytest.approx(np.mean(positive))
    assert row["patch_unmatched"] == pytest.approx(1 - matched / labels)
    assert row["literal_positive"] <= row["projected_positive"] <= row["patch_positive"]


def test_without_labels_nothing_is_lost(objects, grasps, hand):
    config = ScenesConfig(cameras=CameraConfig(width=160, height=120))
    none = {"shape/box": grasps["shape/box"][:0]}
    made = single_scenes(config, {"shape/box": objects["shape/box"]}, none, hand, 1)
    row = label_row(made["shape/box"], none, hand, MatchingConfig(), 64)
    assert row["patch_positive"] == row["labels_per_scene"] == 0
    assert row["patch_unmatched"] is None
