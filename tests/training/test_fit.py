"""Training end to end on toy scenes: it learns, resumes exactly, and explains its failures."""

from __future__ import annotations

import dataclasses
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors.torch import load_file

from dmfc.config.losses import LossConfig, LossWeights, Q1Config
from dmfc.config.training import ProjectionConfig, StageSchedule, TrainingConfig
from dmfc.errors import DmfcError
from dmfc.network.checkpoint import load_network
from dmfc.network.inference import predict
from dmfc.training.failure import read_failure
from dmfc.training.fit import fit
from dmfc.training.module import GraspTraining
from dmfc.training.replay import replay
from dmfc.training.settings import FitConfig
from tests.support.toy import NETWORK, ToyData, toy_atlas, toy_batch, toy_hand, toy_scene

TRAINING = TrainingConfig(
    pretrain=StageSchedule(epochs=4),
    finetune=StageSchedule(epochs=3),
    hard_samples=32,
    hard_stages="both",
    hard_scope="batch",
    rank_points=20,
    accelerator="cpu",
)
LOSSES = LossConfig(weights=LossWeights(1.0, 1.0, 1.0, 1.0, 1.0), q1=Q1Config(directions=64))
CONFIG = FitConfig(NETWORK, LOSSES, TRAINING)


def run(folder: Path, stage="pretrain", config=CONFIG, data=None, **more) -> list[dict]:
    """Fits a stage in `folder` and gives its metrics."""
    data = data or ToyData()
    out = folder / stage
    fit(stage, config, toy_hand(), data, toy_atlas(), out, folder / f"{stage}-work", **more)
    return [json.loads(line) for line in (out / "metrics.jsonl").read_text().splitlines()]


TIMINGS = {"seconds", "scenes_per_second", "time"}
"""Metrics of an epoch that differ from run to run; all others are exact."""


def exact(rows: list[dict]) -> list[dict]:
    return [{k: v for k, v in row.items() if k not in TIMINGS} for row in rows]


def with_epochs(config: FitConfig, stage: str, epochs: int, **more) -> FitConfig:
    schedule = dataclasses.replace(getattr(config.training, stage), epochs=epochs, **more)
    training = dataclasses.replace(config.training, **{stage: schedule})
    return dataclasses.replace(config, training=training)


def test_overfits_a_batch(tmp_path):
    training = dataclasses.replace(TRAINING, hard_samples=0)
    config = dataclasses.replace(CONFIG, training=training)
    config = with_epochs(config, "pretrain", 150, learning_rate=3e-3, decay_every=30)
    rows = run(tmp_path, config=config, data=ToyData(count=4))
    assert rows[-1]["chamfer"] < 0.05 * rows[0]["chamfer"]
    assert rows[-1]["translation_mm"] < 10
    assert rows[-1]["rotation_deg"] < 5
    assert rows[-1]["joints_deg"] < 5


def test_both_stages_write_their_folder(tmp_path):
    told: list[float] = []
    rows = run(tmp_path, progress=lambda fraction, message: told.append(fraction))
    assert [row["epoch"] for row in rows] == [0, 1, 2, 3]
    expected = {"stage", "split", "loss", "chamfer", "gradient_norm", "scenes_per_second"}
    assert expected <= set(rows[0])
    assert "collision" not in rows[0]
    assert told == sorted(told)
    assert told[-1] == pytest.approx(1)
    rows = run(tmp_path, "finetune", init_weights=tmp_path / "pretrain")
    assert {"chamfer", "collision", "guidance", "q1_upper"} <= set(rows[0])
    assert {row["stage"] for row in rows} == {"finetune"}
    files = {path.name for path in (tmp_path / "finetune").iterdir()}
    assert files == {"weights.safetensors", "metrics.jsonl", "config.yaml", "summary.json"}
    summary = json.loads((tmp_path / "finetune/summary.json").read_text())
    assert (summary["stage"], summary["epochs"]) == ("finetune", 3)


def test_finetune_starts_from_the_given_weights(tmp_path):
    run(tmp_path)
    config = with_epochs(CONFIG, "finetune", 1, learning_rate=1e-12)
    run(tmp_path, "finetune", config, init_weights=tmp_path / "pretrain")
    before = load_file(tmp_path / "pretrain/weights.safetensors")
    after = load_file(tmp_path / "finetune/weights.safetensors")
    name = "joints_head.6.weight"
    torch.testing.assert_close(before[name], after[name], rtol=0, atol=1e-9)


class StopError(Exception):
    """What a kill looks like from inside."""


@pytest.mark.parametrize("stage", ["pretrain", "finetune"])
def test_resumes_exactly(tmp_path, stage):
    config = with_epochs(CONFIG, "finetune", 4)

    def die(fraction: float, message: str) -> None:
        if fraction > 0.6:  # in the middle of the third of four epochs
            raise StopError

    expected = run(tmp_path / "whole", stage, config)
    with pytest.raises(StopError):
        run(tmp_path / "parts", stage, config, progress=die)
    resumed = run(tmp_path / "parts", stage, config)
    assert exact(resumed) == exact(expected)
    whole = load_file(tmp_path / "whole" / stage / "weights.safetensors")
    parts = load_file(tmp_path / "parts" / stage / "weights.safetensors")
    for name, value in whole.items():
        assert torch.equal(value, parts[name]), name
    again = run(tmp_path / "parts", stage, config)  # nothing left to do
    assert exact(again) == exact(expected)


PROJECTED = dataclasses.replace(
    CONFIG,
    losses=dataclasses.replace(LOSSES, weights=LossWeights(1.0, 0.0, 1.0, 0.0, 1.0, swept=1.0)),
    training=dataclasses.replace(
        TRAINING,
        finetune_form="projected",
        hard_error="random",
        projection=ProjectionConfig(steps=3),
    ),
)


def test_projected_targets_resume_exactly_with_what_is_diagnosed(tmp_path):
    def die(fraction: float, message: str) -> None:
        if fraction > 0.8:  # in the third of three epochs
            raise StopError

    run(tmp_path, "pretrain")
    start = {"init_weights": tmp_path / "pretrain", "probe": toy_batch(2)}
    expected = run(tmp_path / "whole", "finetune", PROJECTED, **start)
    with pytest.raises(StopError):
        run(tmp_path / "parts", "finetune", PROJECTED, progress=die, **start)
    resumed = run(tmp_path / "parts", "finetune", PROJECTED, **start)
    assert exact(resumed) == exact(expected)
    for row in expected:
        assert 0 <= row["own_terms_fell"] <= 1
        assert row["swept_at_target"] <= row["swept"]
        assert {"own_cosine_easy", "gradient_norm_swept", "swept_at_labels"} <= set(row)
    assert expected[0]["swept_at_labels"] == expected[2]["swept_at_labels"]


def test_projected_targets_need_a_term(tmp_path):
    alone = LossConfig(weights=LossWeights(1.0, 0.0, 0.0, 0.0, 1.0))
    with pytest.raises(DmfcError, match=r"every one of losses\.weights but chamfer is 0"):
        run(tmp_path, "finetune", dataclasses.replace(PROJECTED, losses=alone))


def flipped(path: Path) -> None:
    """One bit in the middle of the file is another."""
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)


def test_a_damaged_checkpoint_is_not_gone_on_from(tmp_path, caplog):
    def die(fraction: float, message: str) -> None:
        if fraction > 0.6:
            raise StopError

    expected = run(tmp_path / "whole")
    with pytest.raises(StopError):
        run(tmp_path / "parts", progress=die)
    (kept,) = (tmp_path / "parts" / "pretrain-work").glob("*.ckpt")
    flipped(kept)
    assert exact(run(tmp_path / "parts")) == exact(expected)
    assert f"'{kept}' is damaged and not used" in caplog.text
    assert len(list(kept.parent.glob("*.ckpt"))) == 1


def test_weights_that_are_not_finite_are_no_result(tmp_path, monkeypatch):
    """Finite losses do not tell of the last step."""
    end = GraspTraining.on_train_epoch_end

    def spoil(self):
        end(self)
        next(self.net.parameters()).data[0] = float("inf")

    monkeypatch.setattr(GraspTraining, "on_train_epoch_end", spoil)
    with pytest.raises(DmfcError, match=r"the weights after pretrain: '.*' has .* not finite"):
        run(tmp_path, config=with_epochs(CONFIG, "pretrain", 1))


def test_seed_decides_the_weights(tmp_path):
    training = dataclasses.replace(TRAINING, seed=1, pretrain=StageSchedule(epochs=1))
    first = run(tmp_path / "a", config=dataclasses.replace(CONFIG, training=training))
    second = run(tmp_path / "b", config=dataclasses.replace(CONFIG, training=training))
    other = run(tmp_path / "c", config=with_epochs(CONFIG, "pretrain", 1))
    assert exact(first) == exact(second)
    assert first[0]["loss"] != other[0]["loss"]


def test_learning_rate_decays(tmp_path):
    config = with_epochs(CONFIG, "pretrain", 5, decay=0.5, decay_every=2)
    rates = [row["learning_rate"] for row in run(tmp_path, config=config)]
    assert rates == pytest.approx([1e-3, 1e-3, 5e-4, 5e-4, 2.5e-4])


def test_validation_rows(tmp_path):
    rows = run(tmp_path, data=ToyData(validation=True))
    measured = [row for row in rows if row["split"] == "val"]
    assert [row["epoch"] for row in measured] == [0, 1, 2, 3]
    assert {"chamfer", "translation_mm", "rotation_deg", "confidence"} <= set(measured[0])
    assert 0 < measured[-1]["rank_overlap"] <= 1
    assert abs(measured[-1]["confidence_rank"]) <= 1


@pytest.mark.parametrize(
    ("field", "stage", "term"),
    [("grasp_position", "pretrain", "chamfer"), ("T_world_object", "finetune", "collision")],
)
def test_a_loss_that_is_not_finite_names_term_and_scene(tmp_path, field, stage, term):
    def spoil(items: list[dict]) -> None:
        getattr(items[5], field)[:] = torch.nan

    with pytest.raises(DmfcError, match=rf"term '{term}' is not finite in scene 105;") as error:
        run(tmp_path, stage, data=ToyData(change=spoil))
    assert "\n" not in str(error.value)
    file = tmp_path / f"{stage}-work/failure.pt"
    assert f"--replay {file}" in str(error.value)
    saved = read_failure(file)
    terms = {row["term"]: row for row in replay(saved, toy_hand(), toy_atlas())}
    assert saved["what"] == f"the term '{term}'"
    assert terms[term]["not_finite"] > 0
    assert terms[term]["in_scenes"] == "105"
    assert terms["confidence"]["not_finite"] == 0
    with pytest.raises(DmfcError, match="'toy' and 2 objects, not of 'other'"):
        replay(saved, dataclasses.replace(toy_hand(), name="other"), toy_atlas())


def test_a_file_that_is_no_saved_batch(tmp_path):
    with pytest.raises(DmfcError, match="there is no file"):
        read_failure(tmp_path / "nothing")
    (tmp_path / "file").write_bytes(b"no pickle")
    with pytest.raises(DmfcError, match="cannot be read as a saved batch"):
        read_failure(tmp_path / "file")
    torch.save({"batch": {}}, tmp_path / "file")
    with pytest.raises(DmfcError, match="this version"):
        read_failure(tmp_path / "file")


def test_a_checkpoint_of_other_data_is_refused(tmp_path):
    run(tmp_path, config=with_epochs(CONFIG, "pretrain", 1), data_digest="a")
    assert json.loads((tmp_path / "pretrain/summary.json").read_text())["data_digest"] == "a"
    with pytest.raises(DmfcError, match="was made with other data"):
        run(tmp_path, config=with_epochs(CONFIG, "pretrain", 2), data_digest="b")


def test_no_label_at_all_is_an_error(tmp_path):
    def unlabel(items: list[dict]) -> None:
        for item in items:
            item.match[:] = False

    with pytest.raises(DmfcError, match=r"nothing to learn .*matching\.distance"):
        run(tmp_path, data=ToyData(change=unlabel))


def test_no_weight_at_all_is_an_error(tmp_path):
    losses = LossConfig(weights=LossWeights(0, 0, 0, 0, 1))
    with pytest.raises(DmfcError, match=r"losses\.weights"):
        run(tmp_path, "finetune", dataclasses.replace(CONFIG, losses=losses))


def test_negatives_can_be_pushed_down(tmp_path):
    base = dataclasses.replace(TRAINING, hard_stages="finetune")
    confidence = {}
    for negatives in ("ignore", "push_down"):
        training = dataclasses.replace(base, negatives=negatives)
        config = dataclasses.replace(CONFIG, training=training)
        config = with_epochs(config, "pretrain", 30, learning_rate=5e-3)
        run(tmp_path / negatives, config=config)
        net = load_network(tmp_path / negatives / "pretrain", toy_hand())
        scene = toy_scene(0)
        found = predict(net, scene.points.numpy())
        order = np.argsort(found.seed_index)
        seeds = np.argsort(scene.seed_index.numpy())
        positive = scene.match.any(1).numpy()[seeds]
        confidence[negatives] = found.confidence[order][~positive].mean()
    assert confidence["push_down"] < confidence["ignore"] - 0.2


def test_prediction_is_of_world_frame_grasps(tmp_path):
    hand = toy_hand()
    run(tmp_path, config=with_epochs(CONFIG, "pretrain", 1))
    net = load_network(tmp_path / "pretrain", hand)
    points = toy_scene(3).points.numpy()
    found = predict(net, points)
    assert found.position.shape == (32, 3)
    np.testing.assert_allclose(
        found.rotation @ found.rotation.transpose(0, 2, 1),
        np.tile(np.eye(3), (32, 1, 1)),
        atol=1e-6,
    )
    assert (found.joints >= hand.lower).all()
    assert (found.joints <= hand.upper).all()
    assert (np.diff(found.confidence) <= 0).all()
    moved = predict(net, points + np.float32([0.5, 0, 0]))
    seeds = np.argsort(found.seed_index), np.argsort(moved.seed_index)
    np.testing.assert_allclose(
        found.position[seeds[0]] + [0.5, 0, 0], moved.position[seeds[1]], atol=1e-4
    )


def test_weights_of_another_hand_or_none_are_errors(tmp_path):
    run(tmp_path, config=with_epochs(CONFIG, "pretrain", 1))
    other = dataclasses.replace(toy_hand(), name="other")
    with pytest.raises(DmfcError, match=r"hand 'toy', not 'other'"):
        load_network(tmp_path / "pretrain", other)
    with pytest.raises(DmfcError, match="holds no trained network"):
        load_network(tmp_path / "nothing", toy_hand())
    three = dataclasses.replace(toy_hand(), lower=np.zeros(3), upper=np.ones(3))
    with pytest.raises(DmfcError, match="do not fit"):
        load_network(tmp_path / "pretrain", three)
    with pytest.raises(DmfcError, match="is needed"):
        predict(load_network(tmp_path / "pretrain", toy_hand()), np.zeros((4, 2)))


def test_both_stages_run_without_simulator_and_orchestration(tmp_path):
    absent = ["ray", "mlflow", "mujoco", "trimesh", "coacd", "pandas"]
    code = f"""
import sys
sys.modules.update(dict.fromkeys({absent}))  # None there: importing it fails
from pathlib import Path
from tests.training.test_fit import CONFIG, run, with_epochs
folder = Path({str(tmp_path)!r})
run(folder, "pretrain", with_epochs(CONFIG, "pretrain", 1))
run(folder, "finetune", with_epochs(CONFIG, "finetune", 1), init_weights=folder / "pretrain")
"""
    root = Path(__file__).resolve().parents[2]
    subprocess.run([sys.executable, "-c", code], check=True, cwd=root)
    assert (tmp_path / "finetune/weights.safetensors").exists()
