"""Rates against hand-computed values, and every way in which rows can be missing."""

import math

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dmfc.errors import DmfcError
from dmfc.report.rates import Rate, objects_of, per_object, rates, reasons, scene_objects


def rows(*outcomes, scene=0):
    """A row per (planned, held)."""
    return pd.DataFrame(
        [
            {
                "scene": scene,
                "trial": trial,
                "object": "ycb/mug",
                "planned": planned,
                "held": held,
                "reason": "" if held else "slipped",
            }
            for trial, (planned, held) in enumerate(outcomes)
        ]
    )


def wilson(successes, n, z=1.959963984540054):
    """Wilson's interval as in his paper (1927), eq. for (p' - p)^2 = z^2 p q / n."""
    p = successes / n
    middle = (p + z * z / (2 * n)) / (1 + z * z / n)
    half = z / (1 + z * z / n) * math.sqrt(p * (1 - p) / n + z * z / (4 * n * n))
    return middle - half, middle + half


def test_a_published_example():
    """Newcombe (1998), Table I: 81 of 263 has the 95 % score interval 0.2553 to 0.3662."""
    assert Rate(81, 263).interval == pytest.approx((0.2553, 0.3662), abs=5e-5)
    assert Rate(0, 20).interval == pytest.approx((0.0, 0.1611), abs=5e-5)


@given(st.integers(1, 5000).flatmap(lambda n: st.tuples(st.integers(0, n), st.just(n))))
def test_intervals_are_wilsons(pair):
    successes, n = pair
    low, high = Rate(successes, n).interval
    assert (low, high) == pytest.approx(wilson(successes, n), abs=1e-9)
    assert low - 1e-12 <= successes / n <= high + 1e-12


def test_the_papers_error_is_the_standard_error_of_400_trials():
    assert round(Rate(268, 400).standard_error, 2) == 0.02
    assert Rate(400, 400).standard_error == 0.0


def test_the_three_rates_and_their_denominators():
    found = rates(rows((True, True), (True, False), (False, False), (True, True)), trials=4)
    assert (found.valid.successes, found.valid.trials) == (3, 4)
    assert (found.success.successes, found.success.trials) == (2, 3)
    assert (found.overall.successes, found.overall.trials) == (2, 4)
    assert found.overall.value == found.valid.value * found.success.value


def scenes(held):
    """Planned trials [n, K] of scenes, of which `held` says what was held."""
    return pd.concat(
        [rows(*((True, bool(x)) for x in line), scene=i) for i, line in enumerate(held)]
    )


def test_trials_of_a_scene_that_all_agree_are_worth_one():
    alike = np.repeat(np.arange(60) % 2, 4).reshape(60, 4)
    found = rates(scenes(alike), 240).overall
    assert (found.value, found.trials) == (0.5, 240)
    assert found.worth == pytest.approx(60, rel=0.03)
    assert found.standard_error == pytest.approx(math.sqrt(0.25 / 60), rel=0.03)
    low, high = found.interval
    assert (low, high) == pytest.approx(wilson(30, 60, 2.0), abs=0.005)


def test_missing_shards_do_not_make_the_interval_narrower():
    generator = np.random.default_rng(0)
    table = scenes(generator.uniform(size=(30, 4)) < 0.5)
    found, whole = rates(table, 160).overall, rates(table, 120).overall
    assert found.trials == 160
    assert found.worth < 160
    assert whole.worth <= 120


def test_new_objects_are_the_wider_claim():
    table = scenes(np.repeat(np.arange(40) // 20, 4).reshape(40, 4))
    table["object"] = (table["scene"] // 5).map("object {}".format)
    narrow, wide = rates(table, 160), rates(table, 160, "objects")
    assert narrow.overall.value == wide.overall.value
    assert wide.overall.worth == pytest.approx(8, rel=0.2)  # eight objects, each all or nothing
    assert narrow.overall.worth == pytest.approx(40, rel=0.1)


def test_a_trial_that_was_aimed_at_none_is_of_the_object_of_its_scene():
    table = scenes([[1, 1], [0, 0], [0, 1]])
    table.loc[table["scene"] == 1, "object"] = ""
    assert list(objects_of(table, {1: "ycb/mug"})) == ["ycb/mug"] * 6
    assert list(objects_of(table, {}))[2:4] == ["scene 1"] * 2
    assert scene_objects(table) == {0: "ycb/mug", 2: "ycb/mug"}


def test_missing_rows_stay_in_the_denominator():
    found = rates(rows((True, True)), trials=8)
    assert found.valid.value == found.overall.value == 1 / 8
    assert found.success.value == 1.0


def test_no_rows_at_all():
    found = rates(rows().reindex(columns=["scene", "trial", "object", "planned", "held"]), 4)
    assert found.overall.value == 0.0
    assert found.success.value is None
    assert found.success.interval is None
    assert found.success.standard_error is None


def test_held_without_a_plan_does_not_count():
    assert rates(rows((False, True)), 1).overall.successes == 0


def test_rows_that_cannot_be_right_are_errors():
    with pytest.raises(DmfcError, match="2 trial rows for 1 trials"):
        rates(rows((True, True), (True, True)), 1)
    twice = pd.concat([rows((True, True)), rows((True, True))])
    with pytest.raises(DmfcError, match="twice"):
        rates(twice, 4)
    with pytest.raises(DmfcError, match="have no columns held"):
        rates(rows((True, True)).drop(columns="held"), 1)


def test_per_object_and_reasons():
    table = pd.concat([rows((True, True), (True, False)), rows((False, False), scene=1)])
    table.loc[table["scene"] == 1, "object"] = ""
    found = per_object(table)
    assert list(found) == ["ycb/mug"]
    assert found["ycb/mug"].overall.value == 0.5
    assert reasons(table, trials=5) == {"missing": 2, "slipped": 2}
