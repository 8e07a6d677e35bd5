"""Grasps that what was seen is in the way of: against brute force and against MuJoCo's planning."""

from __future__ import annotations

import dataclasses

import numpy as np
import torch
from scipy.spatial.transform import Rotation

from dmfc.config.execution import ExecutionConfig
from dmfc.execution.candidates import GraspCandidates
from dmfc.execution.evaluate import Evaluation
from dmfc.geometry.transforms import transform
from dmfc.hand.kinematics import HandKinematics
from dmfc.hand.model import HandModel
from dmfc.prediction.cloud_check import CloudCheck
from dmfc.scenes.scene_set import Scene
from tests.support.execution_shapes import runner, scene_of, standing
from tests.support.grasp_shapes import planned, shape

CONFIG = ExecutionConfig(cloud_check=True)


def shaken(name: str, count: int, seed: int = 0) -> tuple[np.ndarray, GraspCandidates]:
    """Planned grasps of an object on the table, moved by up to 3 cm and turned by up to 0.4 rad."""
    generator = np.random.default_rng(seed)
    T, grasps = standing(name), planned(name)
    rows = generator.integers(len(grasps), size=count)
    T_world_palm = T @ grasps.T_object_palm[rows]
    turn = Rotation.from_rotvec(generator.uniform(-0.23, 0.23, (count, 3))).as_matrix()
    return T, GraspCandidates(
        position=T_world_palm[:, :3, 3] + generator.uniform(-0.017, 0.017, (count, 3)),
        rotation=T_world_palm[:, :3, :3] @ turn,
        joints=grasps.joints[rows],
        confidence=np.ones(count),
        object_index=np.zeros(count, dtype=np.int64),
    )


def surface(name: str, T: np.ndarray, count: int = 4000) -> np.ndarray:
    return shape(name).surface_points[:count] @ T[:3, :3].T + T[:3, 3]


def clear(hand: HandModel, grasps: GraspCandidates, points: np.ndarray) -> np.ndarray:
    T_world_palm = transform(grasps.rotation, grasps.position)
    return CloudCheck(hand, CONFIG).clear(T_world_palm, grasps.joints, points)


def clear_by_hand(hand: HandModel, T: np.ndarray, joints: np.ndarray, points: np.ndarray) -> bool:
    """One grasp: every point against every link at every pose, by the links' own grids."""
    kinematics = HandKinematics(hand)

    def fits(T_palm: np.ndarray, angles: np.ndarray, tolerance: float) -> bool:
        angles = torch.tensor(np.clip(angles, hand.lower, hand.upper))[None]
        T_links = T_palm @ kinematics.forward(angles)[0].numpy()
        for link, place in enumerate(T_links):
            own = hand.collision_points[hand.collision_link == link]
            if (own @ place[2, :3] + place[2, 3] < -CONFIG.approach_tolerance).any():
                return False
            local = (points - place[:3, 3]) @ place[:3, :3]
            if (hand.link_grids[link].distance(local) > tolerance).any():
                return False
        return True

    if not fits(T, joints, CONFIG.grasp_tolerance):
        return False
    for retreat in np.linspace(CONFIG.pregrasp_distance, 0.0, CONFIG.waypoints):
        moved = T.copy()
        moved[:3, 3] -= retreat * T[:3, :3] @ hand.palm_normal
        if not fits(moved, hand.opened(joints), CONFIG.approach_tolerance):
            return False
    return True


def test_the_same_as_every_point_against_every_link(hand: HandModel) -> None:
    T, grasps = shaken("block", 24)
    points = surface("block", T, 400)
    found = clear(hand, grasps, points)
    wanted = [
        clear_by_hand(hand, grasps.T[row], grasps.joints[row], points) for row in range(len(grasps))
    ]
    assert 4 < sum(wanted) < 22
    assert found.tolist() == wanted


def test_with_the_whole_surface_seen_it_agrees_with_planning_on_meshes(hand: HandModel) -> None:
    T, grasps = shaken("block", 200)
    trials = runner([shape("block")], [T])
    found = clear(hand, grasps, surface("block", T))
    planned_ones = np.array(
        [trials.plan(grasps.T[row], grasps.joints[row], 0)[1].planned for row in range(len(grasps))]
    )
    assert 60 < planned_ones.sum() < 140
    assert (found == planned_ones).mean() > 0.95


def test_only_the_table_is_in_the_way_where_nothing_was_seen(hand: HandModel) -> None:
    T, grasps = shaken("block", 12)
    nothing, up = np.zeros((0, 3)), np.array([0.0, 0.0, 0.5])
    high = dataclasses.replace(grasps, position=grasps.position + up)
    low = dataclasses.replace(grasps, position=grasps.position - up)
    assert clear(hand, high, nothing).all()
    assert not clear(hand, low, nothing).any()
    assert clear(hand, grasps[np.zeros(0, dtype=np.int64)], surface("block", T)).shape == (0,)


def test_what_is_in_the_way_is_dropped_before_k_are_chosen(planner: Evaluation) -> None:
    T, grasps = shaken("block", 40)
    scene: Scene = scene_of(10, ["block"], [T], [], points=2000)
    checked = dataclasses.replace(planner, config=CONFIG)
    free = clear(planner.hand, grasps, scene.points)
    assert not free.all()
    kept = {tuple(position) for position in grasps.position[free]}
    chosen = checked.chosen(scene, grasps)
    assert len(chosen) == CONFIG.grasps_per_scene
    assert {tuple(position) for position in chosen.position} <= kept
    assert not {tuple(p) for p in planner.chosen(scene, grasps).position} <= kept
