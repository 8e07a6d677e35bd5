"""Rollouts: which are chosen, and that rows say what was executed."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation

from dmfc.config.outcome import RolloutsConfig
from dmfc.execution.evaluate import Evaluation
from dmfc.execution.rollouts import ROLLOUTS, choose, roll_out
from dmfc.execution.rollouts import shaken as shaken_labels
from dmfc.geometry.transforms import transform
from dmfc.outcome.features import FeatureMaker
from dmfc.outcome.trials import grasps_of, read_trials
from dmfc.scenes.scene_set import SceneSet, write_shard
from tests.execution.test_cloud_check import shaken
from tests.support.execution_shapes import scene_of

CONFIG = RolloutsConfig(per_object=1, uniform=4, confident=2, refused=3)


def test_the_choice_is_clear_confident_refused_and_never_twice(planner: Evaluation) -> None:
    T, grasps = shaken("block", 80)
    generator = np.random.default_rng(5)
    grasps = dataclasses.replace(grasps, confidence=generator.uniform(size=80))
    scene = scene_of(4, ["block"], [T], [], points=2000)
    found = choose(planner, CONFIG, scene, grasps)
    T_world_palm = transform(grasps.rotation, grasps.position)
    clear = planner.cloud_check.clear(T_world_palm, grasps.joints, scene.points)
    assert {name: len(rows) for name, rows in found.items()} == {
        "uniform": 4,
        "confident": 2,
        "refused": 3,
    }
    best = np.flatnonzero(clear)[np.argsort(-grasps.confidence[clear])[:2]]
    assert found["confident"] == best.tolist()
    assert clear[found["uniform"]].all()
    assert not clear[found["refused"]].any()
    every = [row for rows in found.values() for row in rows]
    assert len(set(every)) == len(every)
    assert choose(planner, CONFIG, scene, grasps) == found
    other = choose(planner, dataclasses.replace(CONFIG, seed=7), scene, grasps)
    assert other["uniform"] != found["uniform"]


def test_labels_are_moved_by_the_errors_of_a_network(planner: Evaluation) -> None:
    scene = planner.scenes[0]
    labels = planner.proposals(scene)
    one = labels[np.zeros(1, dtype=int)]
    found = shaken_labels(one, scene, planner.hand, 3, count=4000)
    assert np.isnan(found.confidence).all()
    assert (found.object_index == one.object_index[0]).all()
    # Lengths of errors whose scale is uniform up to twice: the mean scale is 1.
    shift = np.linalg.norm(found.position - one.position, axis=1)
    turn = Rotation.from_matrix(found.rotation @ one.rotation[0].T).magnitude()
    chi = np.sqrt(8 / (3 * np.pi))  # mean length of three normal numbers of variance 1 / 3
    assert shift.mean() == pytest.approx(0.008 * chi, rel=0.05)
    assert turn.mean() == pytest.approx(np.deg2rad(10) * chi, rel=0.05)
    free = (found.joints > planner.hand.lower + 0.3) & (found.joints < planner.hand.upper - 0.3)
    assert np.abs(found.joints - one.joints)[free].max() < 1.0
    assert (found.seed_point >= 0).all()
    again = shaken_labels(one, scene, planner.hand, 3, count=4000)
    np.testing.assert_array_equal(found.position, again.position)
    assert len(shaken_labels(labels[:0], scene, planner.hand, 3)) == 0


def test_rows_are_of_the_grasps_that_were_executed(planner: Evaluation, tmp_path: Path) -> None:
    scene = planner.scenes[0]
    scenes_file = tmp_path / "scenes.parquet"
    write_shard(scenes_file, [scene], {})
    evaluation = dataclasses.replace(planner, scenes=SceneSet.open([scenes_file]))
    roll_out(evaluation, CONFIG, tmp_path)
    rows = pd.read_parquet(tmp_path / ROLLOUTS)
    clear = rows[rows["choice"] != "refused"]
    assert clear["held"].mean() > 0.5  # the labels of this scene hold
    assert rows["seconds_hold"].max() < 0.6
    labels = evaluation.proposals(scene)
    grasps = grasps_of(rows)
    gap = np.abs(grasps.position[:, None] - labels.position).sum(2)
    which = gap.argmin(1)
    np.testing.assert_allclose(grasps.position, labels.position[which], atol=1e-12)
    np.testing.assert_allclose(grasps.rotation, labels.rotation[which], atol=1e-12)
    np.testing.assert_allclose(grasps.joints, labels.joints[which], atol=1e-12)
    runner = evaluation.open(scene)
    again = runner.plan(labels.T[which[0]], labels.joints[which[0]], 0)[1]
    assert again.planned == rows["planned"].iloc[0]


def test_trials_are_read_back_with_features(planner: Evaluation, tmp_path: Path) -> None:
    generator = np.random.default_rng(0)
    scene = planner.scenes[0]
    write_shard(tmp_path / "scenes.parquet", [scene], {})
    evaluation = dataclasses.replace(planner, scenes=SceneSet.open([tmp_path / "scenes.parquet"]))
    roll_out(evaluation, CONFIG, tmp_path)
    rows = pd.read_parquet(tmp_path / ROLLOUTS)
    rows["seed_point"] = generator.integers(len(scene.points), size=len(rows))
    rows["held"] = np.arange(len(rows)) % 2 == 0
    rows.to_parquet(tmp_path / ROLLOUTS)
    maker = FeatureMaker(planner.hand)
    trials = read_trials([(tmp_path / ROLLOUTS, tmp_path / "scenes.parquet")], maker)
    assert len(trials) == len(rows)
    assert trials.held.tolist() == rows["held"].tolist()
    assert trials.clear.tolist() == (rows["choice"] != "refused").tolist()
    np.testing.assert_array_equal(trials.features, maker(grasps_of(rows), scene.points))
