"""What became of the trials, as stacked bars: held, and each reason of failure."""

from __future__ import annotations

from pathlib import Path

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from dmfc.execution.outcome import REASONS
from dmfc.report.figure import plain_text
from dmfc.report.table import SweepTable

HELD = "#54a24b"
COLOURS = (
    "#bab0ac",
    "#4c78a8",
    "#9ecae9",
    "#f2cf5b",
    "#f58518",
    "#e45756",
    "#b279a2",
    "#17327a",
)
"""Of the reasons, in the order of the vocabulary."""
MISSING = "#e8e8e8"
"""Of trials whose rows are missing, since a stage failed or is not done."""
OTHER = "#ff00ff"
"""Of a reason that is not in the vocabulary."""


@plain_text
def draw_failures(table: SweepTable, path: Path) -> None:
    """Write the picture as PNG: a bar per row of the table, as shares of its K x scenes trials."""
    figure = Figure(figsize=(9, 1.8 + 0.5 * len(table.rows)), dpi=110, layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    met = {reason for row in table.rows for reason in row.reasons}
    order = ["held", *(reason for reason in REASONS if reason in met), *sorted(met - set(REASONS))]
    colours = dict(zip(REASONS, COLOURS, strict=True)) | {"held": HELD, "missing": MISSING}
    left = [0.0] * len(table.rows)
    for reason in order:
        counts = [{"held": row.rates.overall.successes, **row.reasons} for row in table.rows]
        widths = [
            count.get(reason, 0) / row.trials for count, row in zip(counts, table.rows, strict=True)
        ]
        colour = colours.get(reason, OTHER)
        axes.barh(range(len(widths)), widths, 0.7, left=left, color=colour, label=reason)
        left = [start + width for start, width in zip(left, widths, strict=True)]
    labels = [f"{row.label}\nn = {row.trials}" for row in table.rows]
    axes.set_yticks(range(len(table.rows)), labels)
    axes.invert_yaxis()
    axes.set_xlim(0, 1)
    axes.set_title(f"{table.title} ({table.preset}): what became of the trials", loc="left")
    figure.legend(loc="outside lower center", ncols=5, frameon=False)
    figure.savefig(path)
