"""The difference that planned trials tell apart, against simulated sweeps."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from dmfc.report.clusters import of_mean
from dmfc.report.power import Power, design_effects
from dmfc.report.table import CellRows, make_table


@pytest.mark.parametrize(("scenes", "rows"), [(100, 1), (100, 8), (40, 1)])
def test_such_a_difference_is_found_in_80_percent(scenes, rows):
    """Scenes whose rates differ, in each of the two rows by themselves."""
    generator = np.random.default_rng(0)
    spread, times, trials = 0.2, 4000, 4
    # Of a scene's mean: p (1 - p) / K of the trials, and what scenes differ by.
    effect = 1 + (trials - 1) * spread**2 / 0.25
    power = Power(scenes, scenes * trials, 1, rows, effect, "known")
    half = power.difference(rows) / 2
    held = [
        generator.binomial(trials, rate + generator.choice([-spread, spread], (times, 1, scenes)))
        for rate in (0.5 + half, 0.5 - half)
    ]
    difference = held[0] - held[1]
    found = of_mean(difference, np.full(difference.shape, trials))
    width = found.half_width(1 - 0.05 / rows)
    share = (difference.mean((1, 2)) / trials > width).mean()
    assert 0.76 <= share <= 0.86  # near a half; the rates are some way from it


def test_the_design_effect_is_that_of_the_rows():
    generator = np.random.default_rng(1)

    def cell(name, rate, alike):
        chance = np.full(200, rate) if not alike else np.where(np.arange(200) % 2, 0.9, 0.1)
        if alike:
            chance = generator.permutation(chance)
        held = generator.uniform(size=(200, 4)) < chance[:, None]
        scene, trial = np.indices(held.shape)
        columns = {"scene": scene.ravel(), "trial": trial.ravel(), "held": held.ravel()}
        return CellRows(
            name, name, 0, 800, pd.DataFrame({**columns, "planned": True, "object": "a"})
        )

    cells = [cell("base", 0.5, False), cell("other", 0.4, False), cell("alike", 0.5, True)]
    cells.append(cell("none", 0.0, False))
    table = make_table(cells, id="i", name="n", title="t", preset="p", baseline="base")
    one, two = design_effects(table)  # not that of the row that held nothing
    assert one == pytest.approx(1, abs=0.15)
    # Scenes at 0.1 and 0.9: 1 + 3 x 0.16 / 0.25 = 2.92 in one of the two rows.
    assert two == pytest.approx((1 + 2.92) / 2, abs=0.25)
