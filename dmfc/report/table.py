"""The table of a sweep: a row per cell, with the paper's figures beside ours."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import pandas as pd

from dmfc.report.rates import Rate, Rates, concatenate, per_object, rates, reasons
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
    seeds: int
    trials: int
    rates: Rates
    paper: Mapping[str, tuple[float, float]]
    failure: str
    objects: Mapping[str, Rates]
    reasons: Mapping[str, int]
    method: MethodCost | None = None
    """None for rows of our own."""

    def rate(self, name: str) -> Rate:
        """'valid', 'success' or 'overall'."""
        return getattr(self.rates, name)


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
    trials: tuple[SearchTrial, ...] = ()
    """Of a search, in the order in which they were suggested."""
    left_out: Mapping[str, str] = field(default_factory=dict)
    """Training objects that models were trained without, and why."""


def make_table(
    cells: Sequence[CellRows],
    *,
    id: str,
    name: str,
    title: str,
    preset: str,
    show: Sequence[str] = NAMES,
    trials: Sequence[SearchTrial] = (),
) -> SweepTable:
    """Pool the seeds of each cell and compute its rates."""
    grouped: dict[str, list[CellRows]] = {}
    for cell in cells:
        grouped.setdefault(cell.name, []).append(cell)
    rows = tuple(_row(group) for group in grouped.values())
    return SweepTable(id, name, title, preset, rows, tuple(show), tuple(trials))


def _row(group: Sequence[CellRows]) -> TableRow:
    first = group[0]
    rows = concatenate([cell.rows.assign(seed=cell.seed) for cell in group if len(cell.rows)])
    trials = sum(cell.trials for cell in group)
    failures = list(dict.fromkeys(cell.failure for cell in group if cell.failure))
    return TableRow(
        name=first.name,
        label=first.label,
        seeds=len(group),
        trials=trials,
        rates=rates(rows, trials),
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
