"""The way of a hand to a grasp, against closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dmfc.config.execution import ExecutionConfig
from dmfc.config.grasps import GraspsConfig
from dmfc.config.scenes import ScenesConfig
from dmfc.hand.approach import Approach
from dmfc.hand.model import HandModel

EXECUTED = Approach.of_execution(
    ExecutionConfig(
        pregrasp_distance=0.06, waypoints=4, approach_tolerance=0.002, grasp_tolerance=0.01
    )
)


def grasp() -> np.ndarray:
    """T_world_palm of a palm whose axes are those of no other frame."""
    T = np.eye(4)
    T[:3, :3] = Rotation.from_rotvec([0.4, -1.1, 0.7]).as_matrix()
    T[:3, 3] = [0.1, -0.2, 0.3]
    return T


def test_the_open_hand_comes_straight_along_the_palm_normal_and_closes(hand: HandModel) -> None:
    T, joints = grasp(), (hand.lower + hand.upper) / 2
    *way, closed = EXECUTED.stops(T, joints, hand)
    back = [(T[:3, 3] - stop.T_palm[:3, 3]) @ T[:3, :3] @ hand.palm_normal for stop in way]
    assert back == pytest.approx([0.06, 0.04, 0.02, 0.0])
    assert back == pytest.approx(EXECUTED.offsets[::-1])
    for stop, distance in zip(way, back, strict=True):
        assert np.linalg.norm(stop.T_palm[:3, 3] - T[:3, 3]) == pytest.approx(distance)
        assert (stop.T_palm[:3, :3] == T[:3, :3]).all()
        wanted = np.maximum(joints - hand.closing.opening * hand.flexion, hand.lower)
        assert stop.joints == pytest.approx(np.minimum(wanted, hand.upper))
    assert EXECUTED.pregrasp(T, hand) == pytest.approx(way[0].T_palm)
    assert (closed.T_palm == T).all()
    assert (closed.joints == joints).all()


def test_contact_may_stop_the_closed_fingers_in_their_target_alone(hand: HandModel) -> None:
    *way, closed = EXECUTED.stops(grasp(), hand.open_joints, hand)
    for stop in way:
        assert (stop.tolerance, stop.target_tolerance, stop.table_tolerance) == (0.002,) * 3
    assert (closed.tolerance, closed.table_tolerance) == (0.002, 0.002)
    assert closed.target_tolerance == 0.01
    strict = EXECUTED.stricter(0.003)
    tolerances = strict.tolerance, strict.grasp_tolerance, strict.table_tolerance
    assert tolerances == pytest.approx((-0.001, 0.007, -0.001))
    assert (strict.offsets == EXECUTED.offsets).all()


def test_one_waypoint_is_the_grasp(hand: HandModel) -> None:
    planned = Approach.of_planner(GraspsConfig(waypoints=1))
    for approach in (planned, Approach.of_labels(ScenesConfig(approach_tolerance=0.004))):
        assert approach.offsets.tolist() == [0.0]
        first, second = approach.stops(grasp(), hand.open_joints, hand)
        assert (first.T_palm == second.T_palm).all()
    assert first.tolerance == first.table_tolerance == 0.004
