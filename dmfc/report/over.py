"""Rates over a setting that cells differ in: a panel per setting, a line per group of cells."""

from __future__ import annotations

import copy
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from dmfc.report.figure import plain_text
from dmfc.report.table import SweepTable, TableRow
from dmfc.sweep.record import CellRecord, SweepRecord


@dataclass(frozen=True)
class Line:
    """Cells that differ in one setting alone, by its value."""

    label: str
    points: tuple[tuple[float, TableRow], ...]
    """Value of the setting and the row there, in ascending order."""


def lines_over(table: SweepTable, sweep: SweepRecord, key: str) -> list[Line]:
    """Groups of two cells or more that differ in the setting `key`, a number, and in no other."""
    rows = {row.name: row for row in table.rows}
    groups: dict[str, dict[float, TableRow]] = {}
    for cell in sweep.cells:
        value = _value(cell.config, key)
        if isinstance(value, int | float) and cell.name in rows:
            groups.setdefault(_rest(cell, key), {})[float(value)] = rows[cell.name]
    return [
        Line(points[min(points)].label, tuple(sorted(points.items(), key=lambda item: item[0])))
        for points in groups.values()
        if len(points) > 1
    ]


@plain_text
def draw_over(table: SweepTable, sweep: SweepRecord, path: Path) -> bool:
    """Write the picture as PNG: the overall rate with its 95 % interval over each setting of
    `sweep.over`. False, and no picture, if no cells differ in one of them alone."""
    panels = {key: found for key in sweep.over if (found := lines_over(table, sweep, key))}
    if not panels:
        return False
    figure = Figure(figsize=(4.4 * len(panels), 3.6), dpi=110, layout="constrained")
    FigureCanvasAgg(figure)
    all_axes = figure.subplots(1, len(panels), sharey=True, squeeze=False)[0]
    for axes, (key, lines) in zip(all_axes, panels.items(), strict=True):
        for line in lines:
            known = [(x, row.rates.overall) for x, row in line.points if row.rates.overall.trials]
            ends = [(x, rate.value or 0.0, rate.interval or (0.0, 0.0)) for x, rate in known]
            below = [value - low for _, value, (low, _) in ends]
            above = [high - value for _, value, (_, high) in ends]
            places, values = [x for x, _, _ in ends], [value for _, value, _ in ends]
            axes.errorbar(places, values, [below, above], marker="o", capsize=3, label=line.label)
        axes.set_xlabel(key.rpartition("scenes.test.")[2])
        axes.set_ylim(0, 1)
        axes.grid(alpha=0.3)
        axes.legend(fontsize=8, frameon=False)
    all_axes[0].set_ylabel("overall rate, 95 % interval")
    figure.suptitle(f"{table.title} ({table.preset})", x=0.01, ha="left", fontsize=11)
    figure.savefig(path)
    return True


def _value(config: Mapping[str, Any], key: str) -> Any:
    value: Any = config
    for name in key.split("."):
        # A setting that is younger than keys are is recorded where it is not at its default.
        value = value.get(name, 0) if isinstance(value, Mapping) else None
    return value


def _rest(cell: CellRecord, key: str) -> str:
    """All of a cell but that setting."""
    config = copy.deepcopy(dict(cell.config))
    *groups, last = key.split(".")
    place: Any = config
    for name in groups:
        place = place[name]
    place.pop(last, None)
    return json.dumps([cell.kind, cell.model, config], sort_keys=True)
