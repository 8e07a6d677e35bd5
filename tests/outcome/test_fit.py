"""A predictor finds a rule that was planted, whoever asks again, and after a kill."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest
import torch

from dmfc.config.outcome import OutcomeConfig
from dmfc.errors import DmfcError
from dmfc.hand.model import HandModel
from dmfc.outcome import fit as fit_module
from dmfc.outcome.features import FeatureMaker
from dmfc.outcome.files import WEIGHTS
from dmfc.outcome.fit import fit, folds, object_weights
from dmfc.outcome.judge import Judge, has_judge, save_judge
from dmfc.outcome.network import OutcomeNet
from dmfc.outcome.trials import Trials
from tests.outcome.test_features import cloud_of, grasps_of

CONFIG = OutcomeConfig(epochs=6, widths=[16], batch_size=64, learning_rate=1e-2)


def planted(count: int = 1200, features: int = 8) -> Trials:
    """Planned where feature 0 is low, held where feature 1 is high, for 15 objects."""
    generator = np.random.default_rng(3)
    X = generator.normal(size=(count, features)).astype(np.float32)
    planned = X[:, 0] + 0.3 * generator.normal(size=count) < 0.8
    held = planned & (X[:, 1] + 0.3 * generator.normal(size=count) > 0)
    number = generator.integers(0, 15, count)
    names = np.array([f"random/{k:03d}" for k in number], dtype=object)
    return Trials(X, planned, held, names, number, np.ones(count, bool))


def test_it_learns_the_rule_and_means_what_it_says(tmp_path: Path) -> None:
    net, report = fit(planted(), dataclasses.replace(CONFIG, epochs=15), 0, tmp_path)
    assert report.trials == 1200
    assert report.held_auc_within > 0.9
    assert report.planned_auc > 0.9
    assert report.calibration_error < 0.06
    with torch.no_grad():
        good, unplanned, loose = net(
            torch.tensor([[-1, 2] + [0] * 6, [3, 2] + [0] * 6, [-1, -2] + [0] * 6]).float()
        )
    assert good.min() > 0.9
    assert unplanned[0] < 0.1
    assert loose[0] > 0.9
    assert loose[1] < 0.1


def test_the_same_seed_gives_the_same_weights_even_after_a_kill(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole, _ = fit(planted(), CONFIG, 1, tmp_path / "whole")
    other, _ = fit(planted(), CONFIG, 2, tmp_path / "other")
    kept = fit_module._KeepLast.on_train_epoch_end

    def killed(self: object, trainer: object, module: object) -> None:
        kept(self, trainer, module)  # type: ignore[arg-type]
        if trainer.current_epoch == 2:  # type: ignore[attr-defined]
            raise RuntimeError("killed")

    monkeypatch.setattr(fit_module._KeepLast, "on_train_epoch_end", killed)
    with pytest.raises(RuntimeError, match="killed"):
        fit(planted(), CONFIG, 1, tmp_path / "parts")
    monkeypatch.undo()
    resumed, _ = fit(planted(), CONFIG, 1, tmp_path / "parts")
    for name, value in whole.state_dict().items():
        assert torch.equal(value, resumed.state_dict()[name]), name
    assert not torch.equal(whole.weights[0], other.weights[0])


def test_an_object_is_left_out_by_one_network_and_objects_weigh_alike() -> None:
    names = np.array(["b", "a", "b", "c", "b", "d"], dtype=object)
    fold = folds(names, 2, 0)
    assert fold[0] == fold[2] == fold[4]
    assert np.bincount(fold[[0, 1, 3, 5]]).tolist() == [2, 2]
    weight = object_weights(names)
    assert weight.mean() == pytest.approx(1.0)
    assert weight[[0, 2, 4]].sum() == pytest.approx(weight[1])
    with pytest.raises(DmfcError, match=r"4 objects for 5 networks.*outcome.members"):
        folds(names, 5, 0)


def test_without_hidden_layers_it_is_a_logistic_regression(tmp_path: Path) -> None:
    net, report = fit(planted(), dataclasses.replace(CONFIG, widths=[]), 0, tmp_path)
    assert [tuple(w.shape) for w in net.weights] == [(5, 8, 2)]
    assert report.held_auc > 0.8


def test_a_judge_comes_back_from_its_files_without_a_hand(hand: HandModel, tmp_path: Path) -> None:
    maker, cloud = FeatureMaker(hand), cloud_of("block")
    torch.manual_seed(0)
    net = OutcomeNet(len(maker.names), [16], 3)
    _, report = fit(planted(), CONFIG, 0, tmp_path / "work")
    save_judge(net, dataclasses.replace(CONFIG, widths=[16]), hand, report, tmp_path)
    grasps = grasps_of("block", slice(0, 6), cloud)
    judge = Judge.load(tmp_path)
    said, expected = judge(grasps, cloud), Judge(net, hand)(grasps, cloud)
    assert judge.hand == hand.name
    np.testing.assert_array_equal(said.held, expected.held)
    np.testing.assert_allclose(said.held, said.planned * said.held_if_planned)
    assert has_judge(tmp_path)
    (tmp_path / WEIGHTS).write_bytes(b"cut short")
    with pytest.raises(DmfcError, match="holds no outcome predictor"):
        Judge.load(tmp_path)
