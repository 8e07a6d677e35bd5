"""Features against brute force, and what they must not depend on."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from dmfc.hand.kinematics import HandKinematics
from dmfc.hand.model import HandModel
from dmfc.outcome.features import REACH, FeatureMaker, SeededGrasps
from dmfc.outcome.solid import CELL
from tests.support.execution_shapes import standing
from tests.support.grasp_shapes import planned, shape


def grasps_of(name: str, rows: slice, cloud: np.ndarray) -> SeededGrasps:
    found, T = planned(name), standing(name)
    T_world_palm = (T @ found.T_object_palm)[rows]
    reference = T_world_palm[:, :3, 3]
    gap = np.linalg.norm(cloud[None] - reference[:, None], axis=2)
    return SeededGrasps(
        position=reference,
        rotation=T_world_palm[:, :3, :3],
        joints=found.joints[rows],
        seed_point=gap.argmin(1),
        confidence=np.linspace(0.2, 0.6, len(T_world_palm)),
    )


def cloud_of(name: str, count: int = 1500) -> np.ndarray:
    T = standing(name)
    return shape(name).surface_points[:count] @ T[:3, :3].T + T[:3, 3]


def columns(maker: FeatureMaker, prefix: str) -> list[int]:
    return [k for k, name in enumerate(maker.names) if name.startswith(prefix)]


def test_gaps_are_distances_of_the_inner_points_to_the_cloud(hand: HandModel) -> None:
    cloud = cloud_of("block")
    grasps, maker = grasps_of("block", slice(0, 6), cloud), FeatureMaker(hand)
    found = maker(grasps, cloud)
    T = np.tile(np.eye(4), (6, 1, 1))
    T[:, :3, :3], T[:, :3, 3] = grasps.rotation, grasps.position
    points, _ = HandKinematics(hand).inner_points(torch.tensor(T), torch.tensor(grasps.joints))
    gap = np.linalg.norm(points.numpy()[:, :, None] - cloud, axis=3).min(2).clip(max=REACH)
    links = np.unique(hand.inner_link)
    expected = np.stack([gap[:, hand.inner_link == link].min(1) for link in links], axis=1)
    np.testing.assert_allclose(found[:, columns(maker, "closed_gap_bone")], expected, atol=1e-6)
    assert (expected < 0.01).any()


def test_names_and_numbers_belong_together(hand: HandModel) -> None:
    cloud = cloud_of("block")
    grasps, maker = grasps_of("block", slice(0, 4), cloud), FeatureMaker(hand)
    found = maker(grasps, cloud)
    assert found.shape == (4, len(maker.names))
    assert len(set(maker.names)) == len(maker.names)
    assert np.isfinite(found).all()
    named = dict(zip(maker.names, found.T, strict=True))
    np.testing.assert_allclose(named["height"], grasps.position[:, 2], rtol=1e-6)
    np.testing.assert_allclose(named["joint3"], grasps.joints[:, 3], rtol=1e-5)
    np.testing.assert_allclose(named["object_height"], cloud[:, 2].max(), rtol=1e-6)
    expected = np.log(grasps.confidence / (1 - grasps.confidence))
    np.testing.assert_allclose(named["logit"], expected, rtol=1e-5)
    R, t = grasps.rotation[1], grasps.position[1]
    local = (cloud - t) @ R
    for k, axis in enumerate("xyz"):
        assert named[f"centre_{axis}"][1] == pytest.approx(local.mean(0)[k], abs=1e-6)
        assert named[f"spread_{axis}"][1] == pytest.approx(local.std(0)[k], abs=1e-6)


def test_a_scene_that_is_turned_and_moved_on_the_table_has_the_same_features(
    hand: HandModel,
) -> None:
    cloud = cloud_of("block")
    grasps, maker = grasps_of("block", slice(0, 5), cloud), FeatureMaker(hand)
    turn = Rotation.from_rotvec([0, 0, 1.3]).as_matrix()
    shift = np.array([0.1, -0.2, 0.0])
    moved = dataclasses.replace(
        grasps, position=grasps.position @ turn.T + shift, rotation=turn @ grasps.rotation
    )
    before, after = maker(grasps, cloud), maker(moved, cloud @ turn.T + shift)
    gridded = [k for k, name in enumerate(maker.names) if "_depth" in name or "_blocked" in name]
    exact = np.setdiff1d(np.arange(len(maker.names)), gridded)
    np.testing.assert_allclose(after[:, exact], before[:, exact], atol=2e-5)
    # The voxels of the field of enclosed places keep to the axes of the world.
    depths = columns(maker, "closed_depth_bone")
    np.testing.assert_allclose(after[:, depths], before[:, depths], atol=CELL)


def test_a_hand_moved_into_a_block_is_deep_in_it(hand: HandModel) -> None:
    cloud = cloud_of("block")
    grasps, maker = grasps_of("block", slice(0, 6), cloud), FeatureMaker(hand)
    ahead = 0.03 * grasps.rotation @ hand.palm_normal
    deeper = dataclasses.replace(grasps, position=grasps.position + ahead)
    column = maker.names.index("open_depth")
    assert (maker(deeper, cloud)[:, column] >= maker(grasps, cloud)[:, column]).all()
    assert maker(deeper, cloud)[:, column].max() > 0.005


def test_fingers_stop_at_an_object_and_nowhere_without_one(hand: HandModel) -> None:
    cloud = cloud_of("block")
    grasps, maker = grasps_of("block", slice(0, 8), cloud), FeatureMaker(hand)
    away = dataclasses.replace(grasps, position=grasps.position + np.array([0, 0, 0.5]))
    touching = columns(maker, "touching_fingers")[0]
    near, far = maker(grasps, cloud)[:, touching], maker(away, cloud)[:, touching]
    assert near.min() >= 2  # each of these was verified to hold
    assert far.max() == 0


def test_nothing_of_no_grasps_and_nan_of_no_confidence(hand: HandModel) -> None:
    cloud, maker = cloud_of("block"), FeatureMaker(hand)
    grasps = grasps_of("block", slice(0, 3), cloud)
    assert maker(grasps_of("block", slice(0, 0), cloud), cloud).shape == (0, len(maker.names))
    unknown = dataclasses.replace(grasps, confidence=np.full(3, np.nan))
    assert np.isnan(maker(unknown, cloud)[:, columns(maker, "logit")]).all()
