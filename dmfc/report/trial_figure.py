"""The trials of a search as a picture: which settings mattered."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from dmfc.report.trials import SearchTrial

TRIED, CHOSEN = "#4c78a8", "#e45756"


def draw_trials(trials: Sequence[SearchTrial], path: Path) -> None:
    """Write the picture as PNG: the objective by trial, and against each setting that is varied."""
    names = list(trials[0].settings)
    known = [(n, trial) for n, trial in enumerate(trials) if trial.value is not None]
    columns = min(3, 1 + len(names))
    rows = -(-(1 + len(names)) // columns)
    figure = Figure(figsize=(9, 2.6 * rows), dpi=110, layout="constrained")
    FigureCanvasAgg(figure)
    panels = figure.subplots(rows, columns, sharey=True, squeeze=False).flat
    for place, axes in enumerate(panels):
        if place > len(names):
            axes.axis("off")
            continue
        xs = [trial.settings[names[place - 1]] if place else n for n, trial in known]
        for (_, trial), x in zip(known, xs, strict=True):
            axes.plot(x, trial.value, "o", color=CHOSEN if trial.best else TRIED)
        positive = all(isinstance(x, int | float) and x > 0 for x in xs)
        if xs and place and positive and max(xs) > 20 * min(xs):
            axes.set_xscale("log")
        axes.set_xlabel("trial" if place == 0 else names[place - 1])
        axes.set_ylabel("objective" if place % columns == 0 else "")
        axes.grid(alpha=0.3)
    figure.suptitle("Trials of the search, the best in red", x=0.01, ha="left", fontsize=11)
    figure.savefig(path)
