"""The order of selection: score, threshold, cloud in two tiers, spread; and that it is lazy."""

from __future__ import annotations

import dataclasses

import numpy as np

from dmfc.config.execution import ExecutionConfig
from dmfc.execution.candidates import GraspCandidates
from dmfc.execution.evaluate import Evaluation
from dmfc.execution.selection import CHUNK, select
from dmfc.geometry.transforms import transform
from tests.execution.test_candidates import some
from tests.execution.test_cloud_check import shaken
from tests.support.execution_shapes import scene_of

CONFIG = ExecutionConfig(cloud_check=True, cloud_margin=0.002, most_confident=8)


def levels_of(level: np.ndarray):  # type: ignore[no-untyped-def]
    """A check by the candidates' numbers, which counts what it was asked."""
    asked: list[int] = []

    def levels(grasps: GraspCandidates) -> np.ndarray:
        asked.extend(grasps.object_index.tolist())
        return level[grasps.object_index]

    return levels, asked


def test_only_the_best_are_checked_until_there_are_enough() -> None:
    candidates = dataclasses.replace(some(200), confidence=np.linspace(1.0, 0.5, 200))
    levels, asked = levels_of(np.full(200, 2))
    found = select(candidates, CONFIG, levels)
    assert asked == list(range(CHUNK))
    assert (found.proposed, found.confident, found.checked, found.clear) == (200, 200, CHUNK, CHUNK)
    assert found.chosen.object_index.max() < 8


def test_what_is_clear_without_the_margin_alone_fills_up_what_is_missing() -> None:
    candidates = dataclasses.replace(some(50), confidence=np.linspace(1.0, 0.5, 50))
    level = np.zeros(50, dtype=int)
    level[[3, 9, 40]] = 1
    level[[20, 30]] = 2
    levels, asked = levels_of(level)
    found = select(candidates, CONFIG, levels)
    assert len(asked) == 50
    assert found.chosen.object_index.tolist() == [20, 30, 3, 9]
    assert (found.checked, found.clear) == (50, 5)


def test_a_predictor_ranks_without_a_threshold_of_confidence() -> None:
    unsure = dataclasses.replace(
        some(30), confidence=np.full(30, 0.01), held=np.linspace(0.1, 0.9, 30)
    )
    assert len(select(unsure, CONFIG).chosen) == 0
    by_outcome = dataclasses.replace(CONFIG, score="outcome", most_confident=4)
    found = select(unsure, by_outcome)
    assert found.chosen.object_index[0] == 29
    assert sorted(found.chosen.object_index) == [26, 27, 28, 29]


def test_the_margin_is_of_the_depth_that_the_check_measures(planner: Evaluation) -> None:
    T, grasps = shaken("block", 120)
    scene = scene_of(10, ["block"], [T], [], points=2000)
    evaluation = dataclasses.replace(planner, config=CONFIG)
    levels = evaluation._levels(scene)
    assert levels is not None
    found = levels(grasps)
    check = evaluation.cloud_check
    T_world_palm = transform(grasps.rotation, grasps.position)
    strict = dataclasses.replace(
        CONFIG,
        approach_tolerance=CONFIG.approach_tolerance - 0.002,
        grasp_tolerance=CONFIG.grasp_tolerance - 0.002,
    )
    narrow = dataclasses.replace(planner, config=strict).cloud_check
    by_tolerance = check.clear(T_world_palm, grasps.joints, scene.points)
    by_margin = narrow.clear(T_world_palm, grasps.joints, scene.points)
    assert (found >= 1).tolist() == by_tolerance.tolist()
    assert (found == 2).tolist() == by_margin.tolist()
    assert 0 < by_margin.sum() < by_tolerance.sum()
