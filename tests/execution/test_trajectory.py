"""The motion of a trial: continuous, within limits, through the poses that are promised."""

from __future__ import annotations

import dataclasses
from itertools import pairwise

import numpy as np
import pytest

from dmfc.config.execution import ExecutionConfig
from dmfc.execution.trajectory import Trajectory, plan_trajectory
from dmfc.hand.model import HandModel
from dmfc.physics.world import qpos_to_pose
from tests.support.physics_shapes import pose, random_pose

CONFIG = ExecutionConfig()
NAMES = ["raise", "descend", "approach", "close", "squeeze", "lift", "hold"]
T_GRASP = pose(0.1, -0.05, 0.15, (0.4, -1.2, 0.7))


@pytest.fixture(scope="module")
def trajectory(hand: HandModel) -> Trajectory:
    return plan_trajectory(T_GRASP, hand.open_joints + 0.3 * hand.flexion, hand, CONFIG)


def test_phases_have_their_names_and_times(trajectory: Trajectory) -> None:
    assert [phase.name for phase in trajectory.phases] == NAMES
    seconds = {phase.name: phase.seconds for phase in trajectory.phases}
    assert seconds["hold"] == 2.0
    for phase in trajectory.phases:
        poses, joints = phase.commands(0.002)
        assert len(poses) == len(joints) == round(phase.seconds / 0.002)
        assert poses.shape[1:] == (7,)
        assert joints.shape[1:] == trajectory.closed.shape


def test_every_phase_begins_where_the_last_one_ended(trajectory: Trajectory) -> None:
    assert np.array_equal(trajectory.phases[0].T_start, trajectory.T_rest)
    for before, after in pairwise(trajectory.phases):
        assert np.array_equal(before.T_end, after.T_start)
        assert np.array_equal(before.joints_end, after.joints_start)
    for phase in trajectory.phases:
        poses, joints = phase.commands(0.002)
        assert qpos_to_pose(poses[-1]) == pytest.approx(phase.T_end, abs=1e-9)
        assert joints[-1] == pytest.approx(phase.joints_end, abs=1e-12)


def test_commands_never_jump_and_stop_between_phases(trajectory: Trajectory) -> None:
    timestep = 0.002
    phases = [phase.commands(timestep) for phase in trajectory.phases]
    poses = np.concatenate([poses for poses, _ in phases])
    joints = np.concatenate([joints for _, joints in phases])
    start = trajectory.T_rest
    assert np.linalg.norm(poses[0, :3] - start[:3, 3]) < 1e-4
    assert qpos_to_pose(poses[0])[:3, :3] == pytest.approx(start[:3, :3], abs=1e-3)
    speed = np.linalg.norm(np.diff(poses[:, :3], axis=0), axis=1) / timestep
    # Minimum jerk: the fastest moment is 15/8 of the mean speed.
    legs = [
        np.linalg.norm(phase.T_end[:3, 3] - phase.T_start[:3, 3]) / phase.seconds
        for phase in trajectory.phases
    ]
    assert speed.max() <= 15 / 8 * max(legs) + 1e-6
    ends = np.cumsum([len(poses) for poses, _ in phases])[:-1]
    assert speed[ends - 1].max() < 0.01
    assert np.abs(np.diff(joints, axis=0)).max() / timestep < 5.0
    assert np.linalg.norm(poses[:, 3:], axis=1) == pytest.approx(1.0)


def test_the_hand_passes_through_the_poses_of_the_protocol(
    hand: HandModel, trajectory: Trajectory
) -> None:
    normal = T_GRASP[:3, :3] @ hand.palm_normal
    retreat = T_GRASP[:3, 3] - trajectory.T_pregrasp[:3, 3]
    assert retreat == pytest.approx(CONFIG.pregrasp_distance * normal)
    assert trajectory.T_raised[:2, 3] == pytest.approx(trajectory.T_pregrasp[:2, 3])
    assert trajectory.T_raised[2, 3] >= CONFIG.rest_height
    assert trajectory.T_rest[:2, 3].tolist() == [0, 0]
    assert trajectory.T_lifted[:2, 3] == pytest.approx(T_GRASP[:2, 3])
    assert trajectory.T_lifted[2, 3] == pytest.approx(CONFIG.rest_height)
    by_name = {phase.name: phase for phase in trajectory.phases}
    assert np.array_equal(by_name["approach"].T_start, trajectory.T_pregrasp)
    for name in ("close", "squeeze"):
        assert np.array_equal(by_name[name].T_start, T_GRASP)
        assert np.array_equal(by_name[name].T_end, T_GRASP)
    for phase in trajectory.phases:
        assert np.array_equal(phase.T_end[:3, :3], T_GRASP[:3, :3])
    for name in ("raise", "descend", "approach"):
        assert np.array_equal(by_name[name].joints_end, trajectory.opened)
    for name in ("close", "squeeze", "lift", "hold"):
        assert np.array_equal(by_name[name].joints_end, hand.squeezed(trajectory.closed))


def test_joints_stay_within_the_limits(hand: HandModel) -> None:
    generator = np.random.default_rng(0)
    for _ in range(20):
        wild = generator.uniform(-4, 4, hand.dofs)
        trajectory = plan_trajectory(random_pose(generator), wild, hand, CONFIG)
        assert np.array_equal(trajectory.closed, np.clip(wild, hand.lower, hand.upper))
        for phase in trajectory.phases:
            _, joints = phase.commands(0.02)
            assert (joints >= hand.lower - 1e-12).all()
            assert (joints <= hand.upper + 1e-12).all()


def test_opening_and_squeezing_move_only_what_closes(
    hand: HandModel, trajectory: Trajectory
) -> None:
    still = hand.flexion == 0
    squeezed = trajectory.phases[-1].joints_end
    assert np.array_equal(trajectory.opened[still], trajectory.closed[still])
    assert np.array_equal(squeezed[still], trajectory.closed[still])
    sign = np.sign(hand.flexion)
    assert (sign * (trajectory.closed - trajectory.opened) >= 0).all()
    assert (sign * (squeezed - trajectory.closed) >= 0).all()


def test_a_grasp_near_the_resting_height_is_lifted_all_the_same(hand: HandModel) -> None:
    for height in (CONFIG.rest_height - 0.02, CONFIG.rest_height + 0.2):
        trajectory = plan_trajectory(pose(0, 0, height), hand.open_joints, hand, CONFIG)
        assert trajectory.T_lifted == pytest.approx(pose(0, 0, height + CONFIG.min_rise))


def test_the_motion_can_begin_at_the_pre_grasp(hand: HandModel, trajectory: Trajectory) -> None:
    config = dataclasses.replace(CONFIG, start="pregrasp")
    short = plan_trajectory(T_GRASP, trajectory.closed, hand, config)
    assert [phase.name for phase in short.phases] == NAMES[2:]
    assert np.array_equal(short.T_rest, trajectory.T_pregrasp)
    assert np.array_equal(short.phases[0].T_start, trajectory.T_pregrasp)
    assert np.array_equal(short.phases[0].joints_start, short.opened)


def test_the_hand_rests_open(hand: HandModel, trajectory: Trajectory) -> None:
    assert np.array_equal(trajectory.phases[0].joints_start, hand.open_joints)
