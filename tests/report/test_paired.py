"""The paired comparison against hand counts, the t test and brute force."""

from __future__ import annotations

import itertools

import numpy as np
import pandas as pd
import pytest
from scipy.stats import ttest_rel

from dmfc.errors import DmfcError
from dmfc.report.paired import compare, together


def rows(held: np.ndarray) -> pd.DataFrame:
    """Trial rows of scenes [n, K] of which `held` says what was held."""
    scenes, trials = np.indices(held.shape)
    return pd.DataFrame(
        {"scene": scenes.ravel(), "trial": trials.ravel(), "planned": True, "held": held.ravel()}
    )


def test_against_hand_counts_and_the_t_test_over_scenes() -> None:
    generator = np.random.default_rng(1)
    a, b = generator.uniform(size=(2, 90, 4)) < np.array([0.7, 0.55])[:, None, None]
    found = compare(rows(a), rows(b))
    assert (found.scenes, found.trials, found.seeds) == (90, 360, 1)
    assert found.difference == pytest.approx(a.mean() - b.mean())
    assert (found.only_a, found.only_b) == ((a & ~b).sum(), (b & ~a).sum())
    expected = ttest_rel(a.mean(1), b.mean(1))
    low, high = expected.confidence_interval(0.95)
    # Nearly: a little of two more scenes is in the spread.
    assert (found.low, found.high) == pytest.approx((low, high), abs=0.001)
    assert found.p == pytest.approx(expected.pvalue, rel=0.1)
    wider = compare(rows(a), rows(b), confidence=0.99)
    assert wider.low < found.low < found.high < wider.high


def test_the_other_way_round_and_a_model_with_itself() -> None:
    generator = np.random.default_rng(2)
    a, b = generator.uniform(size=(2, 20, 4)) < 0.5
    one, two = compare(rows(a), rows(b)), compare(rows(b), rows(a))
    assert (one.difference, one.low, one.high) == (-two.difference, -two.high, -two.low)
    assert one.p == two.p
    same = compare(rows(a), rows(a).sample(frac=1, random_state=0))
    assert (same.difference, same.p) == (0, 1)
    assert -0.05 < same.low < 0 < same.high < 0.05  # twenty scenes do not prove that none differs


def test_seeds_that_differ_widen_the_interval() -> None:
    """Scenes are the same for all seeds: to execute them more often says nothing of a training."""
    generator = np.random.default_rng(3)
    chances = np.array([0.3, 0.6, 0.9])[:, None, None]
    a = generator.uniform(size=(3, 60, 4)) < chances
    b = generator.uniform(size=(3, 60, 4)) < 0.5
    of_seeds = [pd.concat([rows(x[s]).assign(seed=s) for s in range(3)]) for x in (a, b)]
    as_scenes = [rows(x.reshape(180, 4)) for x in (a, b)]
    hierarchical, flat = compare(*of_seeds), compare(*as_scenes)
    assert hierarchical.seeds == 3
    assert hierarchical.difference == flat.difference
    assert hierarchical.high - hierarchical.low > 3 * (flat.high - flat.low)
    assert flat.p < 0.05 < hierarchical.p


def test_over_objects_the_interval_is_wider_where_objects_differ() -> None:
    generator = np.random.default_rng(4)
    objects = np.repeat(np.arange(10), 6)
    chance = np.where(objects < 5, 0.9, 0.4)[:, None]
    a = generator.uniform(size=(60, 4)) < chance
    b = generator.uniform(size=(60, 4)) < 0.5
    named = [rows(x).assign(object=np.repeat(objects, 4).astype(str)) for x in (a, b)]
    scenes, wide = compare(*named), compare(*named, over="objects")
    assert wide.difference == scenes.difference
    expected = ttest_rel(*(x.reshape(10, 24).mean(1) for x in (a, b))).confidence_interval(0.95)
    assert (wide.low, wide.high) == pytest.approx(tuple(expected), abs=0.015)
    assert wide.low < scenes.low < scenes.high < wide.high


def test_holm_is_the_closed_test_of_bonferroni() -> None:
    """Holm (1979): a hypothesis goes where every set that it is in goes by Bonferroni."""
    generator = np.random.default_rng(5)
    base = rows(generator.uniform(size=(40, 4)) < 0.5)
    others = [rows(generator.uniform(size=(40, 4)) < p) for p in (0.5, 0.7, 0.62, 0.65, 0.4)]
    found = together([compare(other, base) for other in others])
    raw = [one.p for one in found]
    for place, one in enumerate(found):
        sets = [
            chosen
            for size in range(1, 6)
            for chosen in itertools.combinations(range(5), size)
            if place in chosen
        ]
        closed = max(min(1, len(chosen) * min(raw[i] for i in chosen)) for chosen in sets)
        assert one.p_holm == pytest.approx(closed)


def test_other_trials_cannot_be_compared() -> None:
    held = np.ones((3, 4), dtype=bool)
    with pytest.raises(DmfcError, match="not of the same scenes"):
        compare(rows(held), rows(held[:2]))
    with pytest.raises(DmfcError, match="in the rows twice"):
        compare(pd.concat([rows(held), rows(held)]), rows(held))
