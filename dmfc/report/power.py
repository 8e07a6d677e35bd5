"""What difference between two rows the planned trials can tell apart."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from scipy.stats import norm
from scipy.stats import t as student

from dmfc.engine.ledger import Ledger
from dmfc.errors import DmfcError
from dmfc.report.clusters import CONFIDENCE
from dmfc.report.collect import read_sweep, resolve_sweeps, table_of
from dmfc.report.table import SweepTable

POWER = 0.8
GUESS = 1.5
"""Design effect of a difference on the same scenes where no rows are stored: about the median of
`results/loss_combinations.*`. Less than that of a rate: what scenes share goes out."""
EXTREME = 0.05
"""Rates nearer to 0 or 1 say little of the design effect."""


@dataclass(frozen=True)
class Power:
    """The least difference of the overall rates of two rows that is found in 80 % of such sweeps.

    At a level of 5 %, two-sided, with rates near a half, where it is largest.
    """

    scenes: int
    trials: int
    """Of a row, over all seeds."""
    seeds: int
    rows: int
    """That are compared with the base."""
    design_effect: float
    """Of the difference: its variance beside that of independent trials."""
    source: str
    """Where the design effect is from."""

    def difference(self, rows: int = 1) -> float:
        """Of one comparison, or of each of `rows` that are corrected for their number."""
        tail = 1 - (1 - CONFIDENCE) / 2 / rows
        reach = student.ppf(tail, max(1, self.scenes - 1)) + norm.ppf(POWER)
        error = math.sqrt(2 * 0.25 * self.design_effect / self.trials)
        return min(1.0, float(reach) * error)

    @property
    def line(self) -> str:
        """As a person reads it."""
        seeds = f"{self.seeds} seeds" if self.seeds > 1 else "one seed"
        each = f" ({self.difference(self.rows):.2f} corrected for {self.rows} rows)"
        return (
            f"{self.trials} trials a row ({self.scenes} scenes, {seeds}) tell overall rates apart "
            f"that differ by {self.difference():.2f}{each if self.rows > 1 else ''}, in 80 % of "
            f"such sweeps; design effect {self.design_effect:.1f}: {self.source}. "
            "How trainings differ is not in it."
        )


def power_of(
    ledger: Ledger, name: str, scenes: int, grasps_per_scene: int, seeds: int, rows: int
) -> Power:
    """The power of a sweep that is planned; its design effect is that of the latest of its name."""
    effect, source = GUESS, "a guess"
    try:
        (known,) = resolve_sweeps(ledger, [name])
        found = design_effects(table_of(ledger, read_sweep(ledger, known)))
    except DmfcError:  # none yet, or its rows are damaged, which a dry run need not tell
        found = []
    if found:
        effect, source = sorted(found)[len(found) // 2], f"measured in {known}"
    trials = scenes * grasps_per_scene * seeds
    return Power(scenes, trials, seeds, rows, effect, source)


def design_effects(table: SweepTable) -> Sequence[float]:
    """Of the difference of each row to the base: its variance beside that of as many independent
    trials."""
    found = []
    for row in table.rows:
        pair = row.paired
        if pair is None or not all(
            EXTREME < rate < 1 - EXTREME for rate in (pair.overall_a, pair.overall_b)
        ):
            continue
        alone = sum(rate * (1 - rate) for rate in (pair.overall_a, pair.overall_b)) / pair.trials
        found.append(pair.standard_error**2 / alone)
    return found
