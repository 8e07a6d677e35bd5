"""Reliability of an outcome predictor: how often it happened of what was said, as a picture."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure


def draw_reliability(rows: Sequence[Mapping[str, Any]], out: Path) -> None:
    """A line per row (`group`, `reliability`, `calibration_error`); the area of a dot is its share
    of the row's trials."""
    figure = Figure(figsize=(5.2, 5.2), layout="constrained")
    axes = figure.subplots()
    axes.plot([0, 1], [0, 1], color="#999999", linewidth=1, label="as said")
    for row in rows:
        said, happened, trials = (row["reliability"][k] for k in ("said", "happened", "trials"))
        name = f"{row['group']} (n = {row['trials']}, error {row['calibration_error']:.3f})"
        (line,) = axes.plot(said, happened, linewidth=1.2, label=name)
        sizes = [400 * count / row["trials"] for count in trials]
        axes.scatter(said, happened, s=sizes, color=line.get_color(), alpha=0.6)
    axes.set(xlim=(0, 1), ylim=(0, 1), aspect="equal")
    axes.set_xlabel("probability of being held that was said")
    axes.set_ylabel("share of trials that held")
    axes.legend(loc="upper left", fontsize=8, frameon=False)
    figure.savefig(out, dpi=150)
