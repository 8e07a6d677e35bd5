"""The table of a sweep: a row per cell, with the paper's figures beside ours."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import pandas as pd

from dmfc.errors import DmfcError
from dmfc.report.paired import Comparison, compare, together
from dmfc.report.rates import (
    Over,
    Rate,
    Rates,
    concatenate,
    per_object,
    rates,
    reasons,
    scene_objects,
)
from dmfc.report.trials import SearchTrial

NAMES = ("valid", "success", "overall")


@dataclass(frozen=True)
class CellRows:
    """One cell at one seed: its trial rows, and how many there should be."""

    name: str
    label: str
    seed: int
    trials: int
    rows: pd.DataFrame
    paper: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    failure: str = ""
    """Why rows are missing; empty if none is."""


@dataclass(frozen=True)
class MethodCost:
    """Of somebody else's method: what it costs, and where it does not answer."""

    seconds: float | None
    """Median wall time per scene; None: not known."""
    failed_scenes: int
    failures: Mapping[str, int]
    """Reason -> scenes."""
    used: str
    """What it asked for besides the cloud."""


@dataclass(frozen=True)
class TableRow:
    """One row: a cell over all its seeds."""

    name: str
    label: str
    trials: int
    rates: Rates
    """With intervals for new scenes of the same objects."""
    new_objects: Rates
    """The same rates with intervals for new objects."""
    by_seed: Mapping[int, Rates]
    """Of each training seed, with intervals for new scenes."""
    paper: Mapping[str, tuple[float, float]]
    failure: str
    objects: Mapping[str, Rates]
    reasons: Mapping[str, int]
    paired: Comparison | None = None
    """Against the base row on the same scenes; None of the base, and where trials differ."""
    method: MethodCost | None = None
    """None for rows of our own."""

    @property
    def seeds(self) -> int:
        """How many seeds were executed, or are to be."""
        return len(self.by_seed)

    def rate(self, name: str, over: Over = "scenes") -> Rate:
        """'valid', 'success' or 'overall'."""
        return getattr(self.rates if over == "scenes" else self.new_objects, name)

    def seed_spread(self, name: str) -> float:
        """Standard deviation of a rate over the seeds; nan with fewer than two."""
        values = [getattr(found, name).value for found in self.by_seed.values()]
        known = [value for value in values if value is not None]
        return float(np.std(known, ddof=1)) if len(known) > 1 else math.nan


@dataclass(frozen=True)
class SweepTable:
    """A table with its title, in the order of the sweep file."""

    id: str
    name: str
    title: str
    preset: str
    rows: tuple[TableRow, ...]
    show: tuple[str, ...] = NAMES
    """Rates that a person is shown; files for machines have all."""
    baseline: str = ""
    """The cell with which the others are compared."""
    trials: tuple[SearchTrial, ...] = ()
    """Of a search, in the order in which they were suggested."""
    left_out: Mapping[str, str] | None = field(default_factory=dict)
    """Training objects that models were trained without, and why; None: not recorded."""

    @property
    def seeds(self) -> tuple[int, ...]:
        """The seeds of all rows."""
        return tuple(sorted({seed for row in self.rows for seed in row.by_seed}))

    def claim(self, over: Over = "scenes") -> str:
        """What the intervals hold for, as a sentence."""
        new = "new scenes of the same objects" if over == "scenes" else "new objects"
        if len(self.seeds) > 1:
            return f"Intervals: 95 %, for {new} and a new training ({len(self.seeds)} seeds)."
        return (
            f"Intervals: 95 %, for {new} with the same trained models (one seed: "
            "they say nothing of another training)."
        )


def make_table(
    cells: Sequence[CellRows],
    *,
    id: str,
    name: str,
    title: str,
    preset: str,
    show: Sequence[str] = NAMES,
    baseline: str = "",
    trials: Sequence[SearchTrial] = (),
) -> SweepTable:
    """Compute the rates of each cell over its seeds, and its difference to the baseline."""
    grouped: dict[str, list[CellRows]] = {}
    for cell in cells:
        grouped.setdefault(cell.name, []).append(cell)
    rows = {name: _rows(group) for name, group in grouped.items()}
    known = scene_objects(concatenate([part for part in rows.values() if len(part)]))
    made = [_row(group, rows[name], known) for name, group in grouped.items()]
    paired = _paired(rows, baseline)
    with_pairs = tuple(replace(row, paired=paired.get(row.name)) for row in made)
    return SweepTable(id, name, title, preset, with_pairs, tuple(show), baseline, tuple(trials))


def _rows(group: Sequence[CellRows]) -> pd.DataFrame:
    return concatenate([cell.rows.assign(seed=cell.seed) for cell in group if len(cell.rows)])


def _row(group: Sequence[CellRows], rows: pd.DataFrame, known: Mapping[int, str]) -> TableRow:
    first = group[0]
    trials = sum(cell.trials for cell in group)
    failures = list(dict.fromkeys(cell.failure for cell in group if cell.failure))
    return TableRow(
        name=first.name,
        label=first.label,
        trials=trials,
        rates=rates(rows, trials),
        new_objects=rates(rows, trials, "objects", known),
        by_seed={cell.seed: rates(_rows([cell]), cell.trials) for cell in group},
        paper=first.paper,
        failure="; ".join(failures),
        objects=per_object(rows),
        reasons=reasons(rows, trials),
        method=method_cost(rows),
    )


def method_cost(rows: pd.DataFrame) -> MethodCost | None:
    """From the columns `method_*` of trial rows, which repeat for each trial of a scene."""
    if "method_failure" not in rows:
        return None
    scenes = rows[rows["method_failure"].notna()].drop_duplicates(
        [name for name in ("seed", "scene") if name in rows]
    )
    if scenes.empty:
        return None
    seconds = scenes["method_seconds"].median()
    failures = scenes.loc[scenes["method_failure"] != "", "method_failure"]
    used = {word for text in scenes["method_used"] for word in str(text).split()}
    return MethodCost(
        seconds=None if pd.isna(seconds) else float(seconds),
        failed_scenes=len(failures),
        failures={str(name): int(count) for name, count in failures.value_counts().items()},
        used=" ".join(sorted(used)),
    )


def _paired(rows: Mapping[str, pd.DataFrame], baseline: str) -> dict[str, Comparison]:
    """Each row against the base, corrected for their number; without those that have no pairs."""
    found: dict[str, Comparison] = {}
    for name, part in rows.items():
        if baseline not in rows or name == baseline:
            continue
        try:
            found[name] = compare(part, rows[baseline])
        except DmfcError:  # of other trials: a shard is missing
            continue
    return dict(zip(found, together(list(found.values())), strict=True))
