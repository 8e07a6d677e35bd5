"""Ranks against all pairs, calibration against a distribution that is known."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread

from dmfc.outcome.calibration import auc, auc_within, platt, reliability
from dmfc.outcome.report import object_intervals
from dmfc.outcome.trials import Trials
from dmfc.visualization.reliability import draw_reliability


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


def test_intervals_of_a_bootstrap_over_objects() -> None:
    generator = np.random.default_rng(0)
    objects = np.repeat([f"o{k}" for k in range(40)], 30).astype(object)
    scene = np.repeat(np.arange(120), 10)
    said = generator.uniform(size=1200)
    held = generator.uniform(size=1200) < said
    trials = Trials(np.zeros((1200, 1)), held, held, objects, scene, np.ones(1200, bool))
    found = object_intervals(said, np.ones(1200), trials)
    # P(the one that happened has the higher score) where score is uniform and is the probability.
    low, high = found["held_auc_within"]
    assert low < 5 / 6 < high
    assert high - low < 0.08
    point = auc_within(said, held, scene)
    assert low < point < high
    # Of independent trials the bootstrap over objects is the one over trials, up to its noise.
    draws = [auc(said[rows], held[rows]) for rows in generator.integers(1200, size=(400, 1200))]
    assert (high - low) == pytest.approx(np.ptp(np.quantile(draws, [0.025, 0.975])), rel=0.5)


def test_the_diagram_has_a_line_per_group(tmp_path: Path) -> None:
    rows = [
        {
            "group": name,
            "trials": 10,
            "calibration_error": 0.1,
            "reliability": {"said": [0.2, 0.8], "happened": [0.3, 0.7], "trials": [4, 6]},
        }
        for name in ("alone", "clutter")
    ]
    draw_reliability(rows, tmp_path / "one.png")
    draw_reliability(rows[:1], tmp_path / "two.png")
    one, two = (imread(tmp_path / name) for name in ("one.png", "two.png"))
    assert one.shape == two.shape
    assert (one != two).any()
