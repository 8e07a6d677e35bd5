"""Whether a table agrees with a reference, row by row."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from dmfc.engine.ledger import Ledger
from dmfc.errors import DmfcError
from dmfc.report.clusters import CONFIDENCE, Spread, of_mean
from dmfc.report.collect import collect, list_sweeps, read_sweep, resolve_sweeps
from dmfc.report.exported import ROWS, read_rows
from dmfc.report.paired import compare
from dmfc.report.rates import concatenate, grid


@dataclass(frozen=True)
class Agreement:
    """The overall rate of one row here and in the reference."""

    table: str
    cell: str
    here: float
    reference: float
    difference: float
    """Here - reference."""
    low: float
    """Interval of the difference: of all rows together 95 %, so of each one more."""
    high: float
    same_scenes: bool
    """Compared in pairs; else as two samples."""
    different: int
    """Of the pairs, those that were held in one alone."""

    @property
    def agrees(self) -> bool:
        """Whether the interval of the difference holds 0."""
        return self.low <= 0 <= self.high

    @property
    def line(self) -> str:
        """As a person reads it."""
        rates = f"{self.table} {self.cell}: {self.here:.2f} here, {self.reference:.2f} there"
        if self.same_scenes and not self.different:
            return f"{rates}: agrees with the reference, the same in every trial"
        verdict = "agrees" if self.agrees else "does NOT agree"
        how = "" if self.same_scenes else ", other scenes"
        interval = f"{self.difference:+.2f} [{self.low:+.2f}, {self.high:+.2f}]{how}"
        return f"{rates}: {verdict} with the reference within its interval ({interval})"

    def row(self) -> dict[str, Any]:
        """All of it, by name."""
        return {**asdict(self), "agrees": self.agrees}


def agreements(ledger: Ledger, reference: Path, names: Sequence[str] = ()) -> list[Agreement]:
    """Each row of the tables in `reference` beside the latest in the store.

    Without `names`, of the tables that both have. Raises DmfcError where there is none, or a table
    that is named is missing in either, and where a row is not complete.
    """
    there = {path.name.removesuffix(ROWS): path for path in sorted(reference.glob(f"*{ROWS}"))}
    known = {sweep_id.rpartition("-")[0] for sweep_id in list_sweeps(ledger)}
    wanted = list(names) or [name for name in there if name in known]
    for name in wanted:
        if name not in there:
            raise DmfcError(f"'{reference}' has no table '{name}' (NAME{ROWS})")
    if not wanted:
        raise DmfcError(f"'{reference}' and the store '{ledger.store}' have no table in common")
    pairs = [
        (name, cell, rows, other)
        for name in wanted
        for cell, rows, other in _cells(ledger, name, read_rows(there[name]))
    ]
    confidence = 1 - (1 - CONFIDENCE) / len(pairs)
    return [_agreement(*pair, confidence) for pair in pairs]


def _cells(
    ledger: Ledger, name: str, reference: pd.DataFrame
) -> list[tuple[str, pd.DataFrame, pd.DataFrame]]:
    """The cells that both have: their name, rows here and rows there."""
    (sweep_id,) = resolve_sweeps(ledger, [name])
    parts: dict[str, list[pd.DataFrame]] = {}
    for cell in collect(ledger, read_sweep(ledger, sweep_id)):
        if cell.failure:
            raise DmfcError(f"{sweep_id}: {cell.name} is not complete: {cell.failure}")
        parts.setdefault(cell.name, []).append(cell.rows.assign(seed=cell.seed))
    return [
        (cell, concatenate(rows), reference[reference["cell"] == cell])
        for cell, rows in parts.items()
        if (reference["cell"] == cell).any()
    ]


def _agreement(
    table: str, cell: str, rows: pd.DataFrame, other: pd.DataFrame, confidence: float
) -> Agreement:
    try:
        found = compare(rows, other, confidence=confidence)
    except DmfcError:  # of other scenes, or of another number of seeds
        return _two_samples(table, cell, rows, other, confidence)
    return Agreement(
        table=table,
        cell=cell,
        here=found.overall_a,
        reference=found.overall_b,
        difference=found.difference,
        low=found.low,
        high=found.high,
        same_scenes=True,
        different=found.only_a + found.only_b,
    )


def _two_samples(
    table: str, cell: str, rows: pd.DataFrame, other: pd.DataFrame, confidence: float
) -> Agreement:
    here, spread = _held(rows)
    there, other_spread = _held(other)
    half = math.hypot(
        float(spread.half_width(confidence)), float(other_spread.half_width(confidence))
    )
    low, high = max(-1.0, here - there - half), min(1.0, here - there + half)
    return Agreement(table, cell, here, there, here - there, low, high, False, 0)


def _held(rows: pd.DataFrame) -> tuple[float, Spread]:
    """The overall rate and its spread over scenes."""
    held = (rows["held"].astype(bool) & rows["planned"].astype(bool)).to_numpy(float)
    return float(held.mean()), of_mean(*grid(rows, "scene", (held, np.ones(len(rows)))))
