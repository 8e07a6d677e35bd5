"""Intervals of trials that come in clusters: how often they hold the truth, and known cases."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from scipy.special import expit, logit
from scipy.stats import beta, ttest_1samp

from dmfc.report.clusters import effective_trials, of_mean, p_value, wilson

TIMES = 4000


def simulated(
    generator: np.random.Generator,
    shape: tuple[int, int, int],
    rate: float,
    correlation: float,
    between_seeds: float,
) -> np.ndarray:
    """Held trials [TIMES, S, C] of K each: scenes by a beta law, seeds by shifts of the logit."""
    seeds, clusters, trials = shape
    weight = (1 - correlation) / correlation
    chance = generator.beta(rate * weight, (1 - rate) * weight, (TIMES, 1, clusters))
    shift = generator.normal(0, between_seeds, (TIMES, seeds, 1)) if between_seeds else 0.0
    chance = expit(logit(np.clip(chance, 1e-9, 1 - 1e-9)) + shift) * np.ones((1, seeds, 1))
    return generator.binomial(trials, chance)


def truth(rate: float, correlation: float, between_seeds: float) -> float:
    """The mean over all scenes and seeds, by quadrature."""
    if not between_seeds:
        return rate
    weight = (1 - correlation) / correlation
    quantiles = (np.arange(4000) + 0.5) / 4000
    chance = beta.ppf(quantiles, rate * weight, (1 - rate) * weight).clip(1e-9, 1 - 1e-9)
    nodes, weights = np.polynomial.hermite_e.hermegauss(15)
    means = expit(logit(chance)[:, None] + between_seeds * nodes).mean(0)
    return float((means * weights).sum() / weights.sum())


@pytest.mark.parametrize(
    ("shape", "rate", "correlation", "between_seeds"),
    [
        ((1, 100, 4), 0.5, 0.3, 0.0),  # Table I: 100 scenes, a design effect of 1.9
        ((1, 100, 4), 0.9, 0.1, 0.0),
        ((1, 50, 4), 0.7, 0.4, 0.0),  # Table II, reduced
        ((1, 16, 24), 0.55, 0.2, 0.0),  # 16 objects of 6 scenes
        ((1, 16, 4), 0.6, 0.4, 0.0),  # the quick preset
        ((3, 100, 4), 0.5, 0.3, 0.0),  # seeds that do not differ
        ((3, 100, 4), 0.7, 0.3, 0.2),
        ((3, 100, 4), 0.6, 0.3, 0.4),  # rates of seeds spread by 0.08
        ((5, 50, 4), 0.5, 0.3, 0.5),
    ],
)
def test_95_percent_intervals_hold_the_truth_in_93_to_97(shape, rate, correlation, between_seeds):
    generator = np.random.default_rng(3)
    held = simulated(generator, shape, rate, correlation, between_seeds)
    tried = np.full(held.shape, shape[2])
    effective, quantile = effective_trials(held, tried)
    low, high = wilson(held.sum((1, 2)) / tried.sum((1, 2)), effective, quantile)
    true = truth(rate, correlation, between_seeds)
    assert 0.93 <= ((low <= true) & (true <= high)).mean() <= 0.97


@pytest.mark.parametrize(
    ("shape", "between_seeds"), [((1, 100, 4), 0.0), ((1, 16, 4), 0.0), ((3, 50, 4), 0.3)]
)
def test_intervals_of_paired_differences_hold_the_truth_too(shape, between_seeds):
    """Two models on the same scenes: what scenes have in common goes out in the difference."""
    generator = np.random.default_rng(4)
    seeds, clusters, trials = shape
    scene = generator.normal(0, 1, (TIMES, 1, clusters))
    chances = [
        expit(
            offset
            + scene
            + generator.normal(0, 0.5, (TIMES, 1, clusters))
            + generator.normal(0, 1, (TIMES, seeds, 1)) * between_seeds
        )
        for offset in (0.8, 0.2)
    ]
    one, two = (generator.binomial(trials, chance) for chance in chances)
    true = float(np.mean(chances[0] - chances[1]))  # over all scenes and seeds that were drawn
    spread = of_mean(one - two, np.full(one.shape, trials))
    found = (one - two).mean((1, 2)) / trials
    assert 0.93 <= (np.abs(found - true) <= spread.half_width()).mean() <= 0.97


def test_an_interval_of_trials_alone_is_far_too_narrow():
    """What the tables had before: the same trials, taken as independent."""
    held = simulated(np.random.default_rng(5), (1, 100, 4), 0.5, 0.5, 0.0)
    rate = held.sum((1, 2)) / 400
    low, high = wilson(rate, np.full(rate.shape, 400.0), np.full(rate.shape, 1.96))
    assert ((low <= 0.5) & (high >= 0.5)).mean() < 0.85


def test_none_and_all_count_a_scene_as_one_trial():
    tried = np.full((1, 100), 4.0)
    for held in (np.zeros((1, 100)), tried):
        effective, quantile = effective_trials(held, tried)
        assert effective == pytest.approx(100, rel=0.02)
        low, high = wilson(held.mean() / 4, effective, quantile)
        assert high - low == pytest.approx(0.038, abs=0.002)  # 3.84 / (3.84 + 100)


def test_scenes_that_are_all_alike_are_worth_their_trials_and_no_more():
    held = np.tile([2.0, 2.0, 3.0, 1.0], (1, 25))
    effective, _ = effective_trials(held, np.full((1, 100), 4.0))
    assert effective == 400


def test_one_scene_says_nothing_of_others():
    effective, quantile = effective_trials(np.array([[3.0]]), np.array([[4.0]]))
    assert wilson(0.75, effective, quantile) == (0, 1)


def test_empty_scenes_do_not_count():
    """Of 6 scenes 2 have no planned trial: the success rate is that of the other 4."""
    held, tried = np.array([[3.0, 0, 4, 1, 0, 2]]), np.array([[4.0, 0, 4, 2, 0, 3]])
    there = tried[0] > 0
    expected = effective_trials(held[:, there], tried[:, there])
    np.testing.assert_allclose(effective_trials(held, tried), expected)


def test_one_seed_is_the_t_test_and_three_are_the_two_way_table():
    """But for the prior, which is a twentieth of a scene each way."""
    values = np.random.default_rng(6).normal(0.05, 0.3, (1, 400))
    spread, mean = of_mean(values, np.ones(values.shape)), float(values.mean())
    expected = ttest_1samp(values[0], 0)
    low, high = expected.confidence_interval(0.95)
    assert float(spread.half_width()) == pytest.approx((high - low) / 2, rel=0.01)
    assert p_value(mean, spread) == pytest.approx(expected.pvalue, rel=0.05)
    seeds, scenes = 3, 200
    table = np.random.default_rng(7).normal(0, 0.3, (seeds, scenes))
    table += np.array([[-0.2], [0.0], [0.3]])
    rest = table - table.mean(1, keepdims=True) - table.mean(0) + table.mean()
    noise = (rest**2).sum() / ((seeds - 1) * (scenes - 1))
    added = (table.mean(1).var(ddof=1) - noise / scenes) / seeds
    found = of_mean(table, np.ones(table.shape))
    assert float(found.seeds) == pytest.approx(added, rel=1e-9)
    assert float(found.clusters) == pytest.approx(table.mean(0).var(ddof=1) / scenes, rel=0.03)


def test_p_is_the_level_whose_interval_just_leaves_0_out():
    table = np.random.default_rng(8).normal(0.1, 0.3, (3, 40))
    spread = of_mean(table, np.ones(table.shape))
    p = p_value(float(table.mean()), spread)
    assert float(spread.half_width(1 - p)) == pytest.approx(abs(table.mean()))


def test_the_order_of_seeds_and_scenes_does_not_matter():
    generator = np.random.default_rng(9)
    held = generator.integers(0, 5, (3, 7)).astype(float)
    tried = np.full((3, 7), 4.0)
    expected = effective_trials(held, tried)
    for seeds in itertools.permutations(range(3)):
        order = generator.permutation(7)
        np.testing.assert_allclose(effective_trials(held[list(seeds)][:, order], tried), expected)
