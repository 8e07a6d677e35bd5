"""The table as a picture: three rates per row with their 95 % intervals, the paper's as crosses."""

from __future__ import annotations

import textwrap
from pathlib import Path

import matplotlib
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from dmfc.report.table import NAMES, SweepTable

COLOURS = {"valid": "#4c78a8", "success": "#f58518", "overall": "#54a24b"}
BAR = 0.26
CLAIM_WIDTH = 90
"""Characters in a line of what the intervals claim."""
plain_text = matplotlib.rc_context({"text.parse_math": False})
"""Decorates what draws labels of users: `$` is a sign in them, and does not begin a formula."""


@plain_text
def draw_rates(table: SweepTable, path: Path) -> None:
    """Write the picture as PNG."""
    figure = Figure(figsize=(9, 1.6 + 0.7 * len(table.rows)), dpi=110, layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    for place, name in enumerate(NAMES):
        for line, row in enumerate(table.rows):
            rate, y = row.rate(name), line + (place - 1) * BAR
            if rate.value is not None and rate.interval is not None:
                low, high = rate.interval
                axes.barh(y, rate.value, BAR * 0.9, color=COLOURS[name])
                axes.plot([low, high], [y, y], color="black", linewidth=1)
            if name in row.paper:
                axes.plot(row.paper[name][0], y, "x", color="black", markersize=6)
        axes.barh(0, 0, color=COLOURS[name], label=name)
    if any(row.paper for row in table.rows):
        axes.plot([], [], "x", color="black", linestyle="none", label="figures of the paper")
    labels = [f"{row.label}\nn = {row.trials}" for row in table.rows]
    axes.set_yticks(range(len(table.rows)), labels)
    axes.set_ylim(len(table.rows) - 0.5, -0.5)
    axes.set_xlim(0, 1)
    axes.grid(axis="x", alpha=0.3)
    claim = textwrap.fill(table.claim(), CLAIM_WIDTH)
    pad = 6 + 11 * (1 + claim.count("\n"))
    axes.set_title(f"{table.title} ({table.preset})", loc="left", fontsize=11, pad=pad)
    axes.annotate(
        claim, (0, 1), (0, 4), xycoords="axes fraction", textcoords="offset points", fontsize=8
    )
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.06), ncols=4, frameon=False)
    figure.savefig(path)
