"""The script that compares validation with simulation, on models made up here."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import spearmanr

from analysis.validation_rank import Model, correlation, draw, shared_measures
from dmfc.report.rates import Rate, Rates


def models(count: int = 6) -> list[Model]:
    """`penetration_mm` falls while the overall rate rises; `coverage` is the same for all."""
    return [
        Model(
            f"model {i}",
            {"penetration_mm": 20.0 - i, "coverage": 0.5, **({"collision": 1.0} if i else {})},
            Rates(Rate(2 * i, 40), Rate(i, 2 * i), Rate(i, 40)),
        )
        for i in range(count)
    ]


def test_correlation_is_scipys_with_an_interval_about_it():
    generator = np.random.default_rng(1)
    measure, rate = generator.standard_normal(10), generator.integers(0, 4, 10) / 40
    found, expected = correlation(measure, rate), spearmanr(measure, rate)
    assert found.value == pytest.approx(expected.statistic)
    assert found.p == pytest.approx(expected.pvalue, abs=0.05)
    assert found.low < found.value < found.high


def test_a_measure_that_tells_and_one_that_does_not():
    made = models()
    rate = np.array([model.rates.overall.value for model in made])
    fallen = np.array([model.measures["penetration_mm"] for model in made])
    told = correlation(fallen, rate)
    assert told.value == pytest.approx(-1)
    assert told.p < 0.02
    assert correlation(np.array([1.0, 5, 2, 4, 3, 1.5]), rate).p > 0.3
    assert shared_measures(made) == ["penetration_mm"]


def test_picture(tmp_path):
    draw(models(), ["penetration_mm"], tmp_path / "picture.png")
    assert (tmp_path / "picture.png").stat().st_size > 5000
