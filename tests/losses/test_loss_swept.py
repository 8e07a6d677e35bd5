"""Swept collision against brute force over the poses that execution plans through."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import torch

from dmfc.config.execution import ExecutionConfig
from dmfc.config.losses import LossConfig, SweptConfig
from dmfc.execution.trajectory import plan_trajectory
from dmfc.geometry.transforms import apply, inverse, transform
from dmfc.hand.approach import Approach
from dmfc.hand.kinematics import HandKinematics
from dmfc.hand.model import HandModel
from dmfc.losses.swept import SweptCollision, grasped
from dmfc.losses.task import SceneTerms
from dmfc.objects.atlas import SceneObjects
from tests.losses.test_loss_task import grasps
from tests.support.loss_shapes import ball_distance, box_distance

EXECUTION = ExecutionConfig(waypoints=4, pregrasp_distance=0.07)
APPROACH = Approach.of_execution(EXECUTION)
CONFIG = SweptConfig(margin=0.006, grasp_tolerance=0.004)


def brute_force(hand: HandModel, scene: SceneObjects, row: int) -> float:
    """Closed-form depths of each point at each pose of the trajectory of execution, by a loop."""
    position, rotation, joints = (x[row].numpy() for x in grasps(hand))
    trajectory = plan_trajectory(transform(rotation, position), joints, hand, EXECUTION)
    poses = []
    for share in (0, 1 / 3, 2 / 3, 1):
        T = trajectory.T_grasp.copy()
        T[:3, 3] += (1 - share) * (trajectory.T_pregrasp[:3, 3] - T[:3, 3])
        poses.append((T, trajectory.opened, False))
    poses.append((trajectory.T_grasp, trajectory.closed, True))
    kinematics, total = HandKinematics(hand), 0.0
    shapes = [ball_distance, box_distance] if row == 0 else [ball_distance]
    for T, angles, closed in poses:
        given = torch.from_numpy(T)[None], torch.from_numpy(angles)[None]
        points = kinematics.collision_points(*given)[0].numpy()
        total += np.square(np.maximum(-points[:, 2] + 0.003, 0)).sum()
        for k, distance in enumerate(shapes):
            depth = distance(apply(inverse(scene.T_world_object[row, k].numpy()), points))
            allowed = 0.004 if closed and k == 0 else -0.003
            total += np.square(np.maximum(depth - allowed, 0)).sum()
    return total / (len(poses) * len(hand.collision_points))


@pytest.mark.parametrize("row", [0, 1])
def test_it_is_what_the_trajectory_of_execution_meets(
    hand: HandModel, scene: SceneObjects, row: int
) -> None:
    swept = SweptCollision(HandKinematics(hand), CONFIG, APPROACH)
    measured = swept(*grasps(hand), scene)[row].item()
    assert measured > 0
    assert measured == pytest.approx(brute_force(hand, scene, row), rel=0.02)


def test_a_hand_that_is_far_off_costs_nothing(hand: HandModel, scene: SceneObjects) -> None:
    position, rotation, joints = grasps(hand)
    away = position + torch.tensor([0.0, 0.0, 0.6])
    swept = SweptCollision(HandKinematics(hand), CONFIG, APPROACH)
    assert (swept(away, rotation, joints, scene) == 0).all()


def test_a_tolerance_of_execution_bounds_that_of_the_loss(hand: HandModel) -> None:
    strict = dataclasses.replace(APPROACH, grasp_tolerance=0.001)
    assert SweptCollision(HandKinematics(hand), CONFIG, strict).grasp_tolerance == 0.001
    assert SweptCollision(HandKinematics(hand), CONFIG, APPROACH).grasp_tolerance == 0.004


def test_the_object_that_is_held_is_the_nearest() -> None:
    distance = torch.tensor([[[-0.3, -0.2], [0.001, -0.02]], [[0.0, 0.01], [-10.0, -10.0]]])
    assert grasped(distance).tolist() == [1, 0]


def test_saturated_terms_are_logarithms(hand: HandModel, scene: SceneObjects) -> None:
    names = ["collision", "swept", "guidance"]
    plain = SceneTerms(hand, LossConfig())(*grasps(hand), scene, names)
    bounded = SceneTerms(hand, LossConfig(saturated=True))(*grasps(hand), scene, names)
    for name in names[:2]:
        assert bounded[name].numpy() == pytest.approx(np.log1p(plain[name].numpy()))
    assert torch.equal(bounded["guidance"], plain["guidance"])
