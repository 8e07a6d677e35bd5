"""Trial rows of scenes: K per scene whatever happens, and the same each time."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from dmfc.config.execution import ExecutionConfig
from dmfc.config.scenes import ScenesConfig
from dmfc.errors import DmfcError
from dmfc.execution.evaluate import DIVERSITY, TRIALS, Evaluation, evaluate_shard
from dmfc.execution.outcome import REASONS
from dmfc.report.rates import rates
from dmfc.scenes.labels import HandAtGrasps, surviving_labels
from dmfc.scenes.scene_set import Scene, SceneSet
from tests.support.execution_shapes import good
from tests.support.grasp_shapes import shape

K = ExecutionConfig().grasps_per_scene


@pytest.fixture(scope="module")
def rows(planner: Evaluation, tmp_path_factory: pytest.TempPathFactory) -> pd.DataFrame:
    folder = tmp_path_factory.mktemp("rows")
    evaluate_shard(planner, folder)
    return pd.read_parquet(folder / TRIALS)


def rows_of(evaluation: Evaluation, scene: Scene) -> pd.DataFrame:
    chosen = evaluation.chosen(scene, evaluation.proposals(scene))
    return pd.DataFrame(list(evaluation.trials(scene, chosen)))


def test_every_scene_has_k_rows_whatever_happens(rows: pd.DataFrame, scenes: SceneSet) -> None:
    assert len(rows) == K * len(scenes)
    assert rows.groupby("scene")["trial"].apply(list).to_dict() == {
        number: list(range(K)) for number in (10, 11, 12)
    }
    missing = rows[rows["reason"] == "no candidate"]
    assert missing.groupby("scene").size().to_dict() == {11: K - 2, 12: K}
    assert not missing["planned"].any()
    assert not missing["held"].any()
    assert (missing["object"] == "").all()
    assert missing["confidence"].isna().all()


def test_every_failure_has_a_reason_and_only_failures(rows: pd.DataFrame) -> None:
    assert (rows["held"] == (rows["reason"] == "")).all()
    assert rows.loc[~rows["held"], "reason"].isin(REASONS).all()
    assert not (rows["held"] & ~rows["planned"]).any()


def test_planned_grasps_hold_and_the_rates_count_what_is_missing(rows: pd.DataFrame) -> None:
    assert rows.loc[rows["scene"] == 10, "held"].sum() >= 2
    assert set(rows.loc[rows["scene"] == 11, "object"][:2]) == {shape("ball").id, shape("block").id}
    found = rates(rows, trials=3 * K)
    assert found.overall.trials == found.valid.trials == 3 * K
    assert found.success.trials == rows["planned"].sum()
    assert found.overall.successes == rows["held"].sum()


def test_the_same_again(planner: Evaluation, rows: pd.DataFrame, tmp_path: Path) -> None:
    told: list[float] = []
    evaluate_shard(planner, tmp_path, lambda fraction, message: told.append(fraction))
    pd.testing.assert_frame_equal(pd.read_parquet(tmp_path / TRIALS), rows, check_exact=True)
    spread = pd.read_parquet(tmp_path / DIVERSITY).set_index("scene")
    assert spread["proposed"].to_dict() == {10: len(good("block")), 11: 2, 12: 0}
    assert spread["executed"].to_dict() == {10: K, 11: 2, 12: 0}
    assert told == pytest.approx([1 / 3, 2 / 3, 1])


def test_a_scene_does_not_depend_on_those_before_it(
    planner: Evaluation, rows: pd.DataFrame
) -> None:
    alone = rows_of(planner, planner.scenes[1])
    expected = rows[rows["scene"] == 11].reset_index(drop=True)
    pd.testing.assert_frame_equal(alone, expected, check_exact=True)


def test_the_random_row_is_executed_likewise(planner: Evaluation) -> None:
    evaluation = dataclasses.replace(planner, source="random", grasps=None)
    rows = rows_of(evaluation, planner.scenes[2])
    assert len(rows) == K
    assert rows["object"].unique().tolist() == [shape("block").id]
    assert rows.loc[~rows["held"], "reason"].isin(REASONS).all()
    assert "no candidate" not in set(rows["reason"])


def test_the_planner_beats_chance_by_half(planner: Evaluation, rows: pd.DataFrame) -> None:
    chance = rows_of(dataclasses.replace(planner, source="random", grasps=None), planner.scenes[0])
    assert rows.loc[rows["scene"] == 10, "held"].mean() - chance["held"].mean() >= 0.5


def test_grasps_of_low_confidence_are_not_executed(planner: Evaluation) -> None:
    unsure = {
        name: dataclasses.replace(grasps, robustness=np.full(len(grasps), 0.1))
        for name, grasps in (planner.grasps or {}).items()
    }
    evaluation = dataclasses.replace(planner, grasps=unsure)
    rows = rows_of(evaluation, planner.scenes[0])
    assert rows["reason"].tolist() == ["no candidate"] * K


@pytest.mark.parametrize("row", ["model", "random"])
def test_a_row_gets_what_it_needs_and_nothing_else(planner: Evaluation, row: str) -> None:
    with pytest.raises(DmfcError, match=f"'{row}'"):
        dataclasses.replace(planner, source=row)
    with pytest.raises(DmfcError, match="'planner'"):
        dataclasses.replace(planner, grasps=None)


def test_the_planner_labels_scenes_without_labels_itself(planner: Evaluation) -> None:
    """Exactly as the scenes would have been labelled when they were made."""
    config, grasps = ScenesConfig(), planner.grasps
    assert grasps is not None
    models = [planner.objects[name] for name in planner.scenes[1].object_ids]
    bare = dataclasses.replace(
        planner.scenes[1], grasp_object=np.zeros(0, np.uint8), grasp_index=np.zeros(0, np.int32)
    )
    labels = surviving_labels(
        config, models, bare.T_world_object, grasps, HandAtGrasps(planner.hand)
    )
    labelled = dataclasses.replace(
        bare, grasp_object=labels.grasp_object, grasp_index=labels.grasp_index
    )
    expected = planner.proposals(labelled)
    assert len(expected) > 1
    assert len(planner.proposals(bare)) == 0
    found = dataclasses.replace(planner, labels=config).proposals(bare)
    np.testing.assert_array_equal(found.T, expected.T)
    np.testing.assert_array_equal(found.joints, expected.joints)
    np.testing.assert_array_equal(found.object_index, expected.object_index)
