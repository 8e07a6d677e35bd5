"""Loss per epoch of every model of a sweep, both stages of training."""

from __future__ import annotations

from pathlib import Path

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from dmfc.engine.ledger import Ledger
from dmfc.pipeline.artifacts import load_metrics
from dmfc.report.figure import plain_text
from dmfc.sweep.record import SweepRecord

STAGES = ("pretrain", "finetune")


@plain_text
def draw_curves(ledger: Ledger, sweep: SweepRecord, path: Path) -> bool:
    """Write the picture as PNG: a panel per stage. False, and no picture, if no model is there."""
    curves: dict[str, dict[str, tuple[str, list[tuple[int, float]]]]] = {s: {} for s in STAGES}
    for cell in sweep.cells:
        for address in (cell.pretrain, cell.model):
            if not address or not ledger.finished(address):
                continue
            stage = address.partition("/")[0]
            shared = stage == "pretrain"
            name = "all cells" if shared else cell.label
            points = _losses(ledger.verified(address))
            curves[stage].setdefault(address, (f"{name}, seed {cell.seed}", points))
    panels = [stage for stage in STAGES if curves[stage]]
    if not panels:
        return False
    figure = Figure(figsize=(9, 3.6), dpi=110, layout="constrained")
    FigureCanvasAgg(figure)
    for place, stage in enumerate(panels):
        axes = figure.add_subplot(1, len(panels), place + 1)
        lines, labels = [], []
        for label, points in curves[stage].values():
            lines.append(
                axes.plot(
                    [x for x, _ in points], [y for _, y in points], linewidth=1.2, marker="."
                )[0]
            )
            labels.append(label)
        axes.set_title(f"{stage}: training loss", loc="left", fontsize=11)
        axes.set_xlabel("epoch")
        axes.xaxis.set_major_locator(MaxNLocator(integer=True, min_n_ticks=1))
        last = max((x for _, points in curves[stage].values() for x, _ in points), default=1)
        axes.set_xlim(0.5, last + 0.5)  # one epoch alone would have fractions beside it
        axes.grid(alpha=0.3)
        if len(curves[stage]) <= 12:  # more do not fit
            axes.legend(lines, labels, fontsize=8, frameon=False)  # given, '_x' is shown too
    figure.savefig(path)
    return True


def _losses(folder: Path) -> list[tuple[int, float]]:
    """Epochs (from 1) and the training loss of each."""
    lines = load_metrics(folder)
    return [(line["epoch"] + 1, line["loss"]) for line in lines if line["split"] == "train"]
