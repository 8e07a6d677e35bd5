"""The paired comparison against hand counts and brute force."""

from __future__ import annotations

import itertools
from math import comb

import numpy as np
import pandas as pd
import pytest

from dmfc.errors import DmfcError
from dmfc.report.paired import compare


def rows(held: np.ndarray) -> pd.DataFrame:
    """Trial rows of scenes [n, K] of which `held` says what was held."""
    scenes, trials = np.indices(held.shape)
    return pd.DataFrame(
        {"scene": scenes.ravel(), "trial": trials.ravel(), "planned": True, "held": held.ravel()}
    )


def test_against_hand_counts_and_every_turn_of_signs() -> None:
    generator = np.random.default_rng(1)
    a, b = generator.uniform(size=(2, 9, 4)) < np.array([0.8, 0.5])[:, None, None]
    found = compare(rows(a), rows(b))
    assert (found.scenes, found.trials) == (9, 36)
    assert found.difference == pytest.approx(a.mean() - b.mean())
    assert (found.only_a, found.only_b) == ((a & ~b).sum(), (b & ~a).sum())
    n, k = found.only_a + found.only_b, min(found.only_a, found.only_b)
    exact = min(1.0, 2 * sum(comb(n, i) for i in range(k + 1)) / 2**n)
    assert found.p_mcnemar == pytest.approx(exact)
    per_scene = a.mean(1) - b.mean(1)
    signs = np.array(list(itertools.product([1, -1], repeat=9)))
    means = (signs * per_scene).mean(1)
    as_far = np.abs(means) >= np.abs(per_scene.mean()) - 1e-12
    assert found.p_scenes == pytest.approx(as_far.mean())
    assert found.low < found.difference < found.high
    # The normal approximation of the interval, which is not far off for nine scenes.
    error = per_scene.std(ddof=0) / 3
    assert found.high - found.low == pytest.approx(2 * 1.96 * error, rel=0.15)


def test_the_other_way_round_and_a_model_with_itself() -> None:
    generator = np.random.default_rng(2)
    a, b = generator.uniform(size=(2, 20, 4)) < 0.5
    one, two = compare(rows(a), rows(b)), compare(rows(b), rows(a))
    assert one.difference == -two.difference
    assert one.p_mcnemar == two.p_mcnemar
    same = compare(rows(a), rows(a).sample(frac=1, random_state=0))
    assert (same.difference, same.low, same.high) == (0, 0, 0)
    assert (same.p_scenes, same.p_mcnemar) == (1, 1)


def test_other_trials_cannot_be_compared() -> None:
    held = np.ones((3, 4), dtype=bool)
    with pytest.raises(DmfcError, match="not of the same scenes"):
        compare(rows(held), rows(held[:2]))
    with pytest.raises(DmfcError, match="there twice"):
        compare(pd.concat([rows(held), rows(held)]), rows(held))
