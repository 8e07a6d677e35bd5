"""Ranks against all pairs, calibration against a distribution that is known."""

from __future__ import annotations

import numpy as np
import pytest

from dmfc.outcome.calibration import auc, auc_within, platt, reliability


def auc_by_pairs(score: np.ndarray, happened: np.ndarray) -> float:
    pairs = [
        (s > t) + 0.5 * (s == t)
        for s, good in zip(score, happened, strict=True)
        if good
        for t, other in zip(score, happened, strict=True)
        if not other
    ]
    return float(np.mean(pairs))


def test_auc_counts_pairs_and_ties_half() -> None:
    generator = np.random.default_rng(1)
    score, happened = generator.integers(0, 6, 40) / 5, generator.uniform(size=40) < 0.4
    assert auc(score, happened) == pytest.approx(auc_by_pairs(score, happened))
    assert np.isnan(auc(score, np.ones(40, bool)))


def test_within_scenes_only_pairs_of_one_scene_count() -> None:
    score = np.array([0.9, 0.1, 0.8, 0.2, 0.3, 0.7])
    happened = np.array([1, 0, 0, 1, 1, 1], bool)
    scene = np.array([0, 0, 1, 1, 2, 2])  # right, wrong, no pair
    assert auc_within(score, happened, scene) == 0.5
    assert auc_within(score, happened, np.zeros(6)) == pytest.approx(auc(score, happened))
    assert np.isnan(auc_within(score, np.ones(6, bool), scene))


def test_calibration_finds_how_much_too_sure_logits_are() -> None:
    generator = np.random.default_rng(2)
    true = generator.normal(size=40_000)
    happened = generator.uniform(size=len(true)) < 1 / (1 + np.exp(-true))
    slope, shift = platt(3.0 * true + 1.0, happened, np.ones(len(true)))
    assert slope == pytest.approx(1 / 3, abs=0.02)
    assert shift == pytest.approx(-1 / 3, abs=0.04)
    assert platt(-true, happened, np.ones(len(true)))[0] == 0.0  # an order is not turned round


def test_the_error_is_what_is_said_less_what_happens() -> None:
    said = np.repeat([0.25, 0.75], 100)
    happened = np.concatenate([np.arange(100) < 25, np.arange(100) < 55])
    found = reliability(said, happened)
    assert found.trials == [100, 100]
    assert found.happened == [0.25, 0.55]
    assert found.error == pytest.approx(0.1)
