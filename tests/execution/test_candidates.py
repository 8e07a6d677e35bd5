"""Where executed grasps come from, and how K of them are chosen."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dmfc.config.execution import ExecutionConfig
from dmfc.execution.candidates import (
    GraspCandidates,
    at_random,
    from_labels,
    from_prediction,
)
from dmfc.execution.selection import select
from dmfc.hand.model import HandModel
from dmfc.network.inference import PredictedGrasps
from tests.support.execution_shapes import scene_of, standing
from tests.support.grasp_shapes import planned, shape

CONFIG = ExecutionConfig(most_confident=0)


def some(count: int, seed: int = 0) -> GraspCandidates:
    generator = np.random.default_rng(seed)
    return GraspCandidates(
        position=generator.uniform(-0.2, 0.2, (count, 3)),
        rotation=Rotation.random(count, random_state=generator).as_matrix(),
        joints=generator.uniform(0, 1, (count, 2)),
        confidence=generator.uniform(0, 1, count),
        object_index=np.arange(count),  # names the candidate in what is selected
    )


def chosen(candidates: GraspCandidates, config: ExecutionConfig) -> GraspCandidates:
    return select(candidates, config).chosen


def spread_by_hand(position: np.ndarray, count: int) -> list[int]:
    """Farthest point sampling from row 0, by its definition."""
    chosen = [0]
    while len(chosen) < count:
        gaps = [min(np.linalg.norm(p - position[c]) for c in chosen) for p in position]
        chosen.append(int(np.argmax(gaps)))
    return chosen


@pytest.mark.parametrize("seed", range(5))
def test_k_are_spread_over_those_that_are_confident(seed: int) -> None:
    candidates = some(60, seed)
    order = np.argsort(-candidates.confidence, kind="stable")
    order = order[candidates.confidence[order] >= CONFIG.min_confidence]
    expected = order[spread_by_hand(candidates.position[order], 4)]
    found = chosen(candidates, CONFIG)
    assert found.object_index.tolist() == expected.tolist()
    assert found.object_index[0] == np.argmax(candidates.confidence)
    assert np.array_equal(found.position, candidates.position[expected])
    assert np.array_equal(found.joints, candidates.joints[expected])


def test_the_threshold_keeps_what_is_on_it_and_drops_what_is_no_number() -> None:
    confidence = np.array([0.15, 0.1499, 0.9, np.nan, 0.0])
    candidates = dataclasses.replace(some(5), confidence=confidence)
    assert chosen(candidates, CONFIG).object_index.tolist() == [2, 0]


def test_no_more_than_there_are_and_none_of_none() -> None:
    three = dataclasses.replace(some(3), confidence=np.array([0.2, 0.9, 0.5]))
    assert chosen(three, CONFIG).object_index.tolist() == [1, 2, 0]
    unsure = dataclasses.replace(some(3), confidence=np.full(3, 0.1))
    assert len(chosen(unsure, CONFIG)) == 0
    assert len(chosen(some(0), CONFIG)) == 0
    assert len(chosen(some(60), dataclasses.replace(CONFIG, grasps_per_scene=7))) == 7


def test_equal_confidences_keep_their_order() -> None:
    candidates = dataclasses.replace(some(4), confidence=np.full(4, 0.5))
    assert chosen(candidates, CONFIG).object_index.tolist() == [0, 1, 2, 3]


def test_labels_are_carried_into_the_world(hand: HandModel) -> None:
    grasps = {}
    for first, name in enumerate(("block", "ball")):
        robustness = (first + np.arange(len(planned(name)))) / 100
        grasps[shape(name).id] = dataclasses.replace(planned(name), robustness=robustness)
    T = [standing("ball", 0.1, 0.05), standing("block", -0.1, 0.0, turn=0.7)]
    labels = [(1, 2), (0, 1), (0, 3)]  # a scene need not group them by object
    found = from_labels(scene_of(0, ["ball", "block"], T, labels), grasps, hand)
    assert found.object_index.tolist() == [0, 0, 1]
    for row, (k, name, index) in enumerate([(0, "ball", 1), (0, "ball", 3), (1, "block", 2)]):
        expected = T[k] @ planned(name).T_object_palm[index]
        assert found.T[row] == pytest.approx(expected, abs=1e-12)
        assert np.array_equal(found.joints[row], planned(name).joints[index])
        assert found.confidence[row] == grasps[shape(name).id].robustness[index]


def test_a_scene_without_labels_has_no_candidates(hand: HandModel) -> None:
    scene = scene_of(0, ["block"], [standing("block")], [])
    assert len(from_labels(scene, {shape("block").id: planned("block")}, hand)) == 0


def test_a_prediction_aims_at_the_object_of_its_seed_point() -> None:
    T = [standing("block", -0.1), standing("ball", 0.1)]
    scene = scene_of(0, ["block", "ball"], T, [])
    seeds = np.array([5, 17, 200])
    raw = some(3)
    predicted = PredictedGrasps(
        raw.position, raw.rotation, raw.joints, raw.confidence, seed_index=seeds
    )
    found = from_prediction(scene, predicted)
    assert found.object_index.tolist() == scene.point_object[seeds].tolist()
    assert np.array_equal(found.position, raw.position)
    assert np.array_equal(found.confidence, raw.confidence)


def test_random_grasps_know_nothing_but_the_cloud(hand: HandModel) -> None:
    scene = scene_of(3, ["block"], [standing("block")], [])
    found = at_random(scene, hand, CONFIG)
    assert len(found) == 512
    again = at_random(scene, hand, CONFIG)
    assert np.array_equal(found.position, again.position)
    assert np.array_equal(found.joints, again.joints)
    other = at_random(dataclasses.replace(scene, scene=4), hand, CONFIG)
    assert not np.array_equal(found.position, other.position)
    reseeded = at_random(scene, hand, dataclasses.replace(CONFIG, seed=1))
    assert not np.array_equal(found.position, reseeded.position)
    gap = np.linalg.norm(found.position[:, None] - scene.points[None], axis=2).min(axis=1)
    assert gap.max() <= CONFIG.random_offset + 1e-6
    assert (found.joints >= hand.lower).all()
    assert (found.joints <= hand.upper).all()
    # Uniform rotations: every column is spread evenly over the sphere.
    assert np.abs(found.rotation.mean(axis=0)).max() < 0.12
    assert np.linalg.det(found.rotation) == pytest.approx(1.0)


def test_farthest_points_are_looked_for_among_the_most_confident_alone() -> None:
    """On a line, less and less confident: K of the first 8 are its ends and what lies between."""
    line = some(20)
    line.position[:] = np.arange(20)[:, None]
    line.confidence[:] = np.linspace(1.0, 0.5, 20)
    few = dataclasses.replace(CONFIG, grasps_per_scene=2, most_confident=8)
    assert chosen(line, few).position[:, 0].tolist() == [0.0, 7.0]
    every = dataclasses.replace(few, most_confident=0)
    assert chosen(line, every).position[:, 0].tolist() == [0.0, 19.0]
