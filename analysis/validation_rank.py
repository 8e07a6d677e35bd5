"""Does validation without a simulator tell how models fare in simulation? Reads a finished sweep.

python -m analysis.validation_rank STORE [SWEEP] [PICTURE.png]      (default: study)

For each measure of the last validation of each model: Spearman's correlation over the models with
the share of trials that held and that could be planned, its p-value, and its 95 % interval over
models drawn with replacement.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from scipy.stats import permutation_test, spearmanr

from dmfc.config.validation import MEASURES
from dmfc.engine.ledger import Ledger
from dmfc.pipeline.artifacts import load_metrics
from dmfc.report.collect import cell_rows, read_sweep, resolve_sweeps
from dmfc.report.rates import Rates, rates

DRAWS = 2000
PICTURED = 4


@dataclass(frozen=True)
class Model:
    """One trained cell of the sweep."""

    name: str
    measures: dict[str, float]
    """The last validation."""
    rates: Rates


def models_of(ledger: Ledger, sweep_id: str) -> list[Model]:
    """The cells that were both validated and executed."""
    found = []
    for cell in read_sweep(ledger, sweep_id).cells:
        if not cell.model or not ledger.finished(cell.model):
            continue
        metrics = load_metrics(ledger.folder(cell.model))
        validated = [row for row in metrics if row["split"] == "val"]
        executed = cell_rows(ledger, cell, {})
        if validated and not executed.failure:
            measured = {name: validated[-1][name] for name in MEASURES if name in validated[-1]}
            found.append(Model(cell.name, measured, rates(executed.rows, int(executed.trials))))
    return found


@dataclass(frozen=True)
class Correlation:
    """Spearman's, of one measure with one rate."""

    value: float
    p: float
    low: float
    high: float


def correlation(measure: np.ndarray, rate: np.ndarray) -> Correlation:
    """Of n models' [n] measures and rates. p: two-sided, by permutation."""

    def statistic(order: np.ndarray) -> float:
        return float(spearmanr(order, rate).statistic)

    test = permutation_test(
        (measure,), statistic, permutation_type="pairings", n_resamples=DRAWS, rng=0
    )
    generator, drawn = np.random.default_rng(0), []
    while len(drawn) < DRAWS:
        rows = generator.integers(0, len(rate), len(rate))
        if np.ptp(measure[rows]) > 0 and np.ptp(rate[rows]) > 0:
            drawn.append(float(spearmanr(measure[rows], rate[rows]).statistic))
    low, high = np.quantile(drawn, [0.025, 0.975])
    return Correlation(float(test.statistic), float(test.pvalue), float(low), float(high))


def shared_measures(models: list[Model]) -> list[str]:
    """Those that every model has and that differ between models."""
    names = [name for name in MEASURES if all(name in model.measures for model in models)]
    return [name for name in names if len({model.measures[name] for model in models}) > 1]


def value_of(model: Model, rate: str) -> float:
    """A rate over all trials: its denominator is the same for all models."""
    return float(getattr(model.rates, rate).value or 0.0)


def draw(models: list[Model], names: list[str], path: Path) -> None:
    """The overall rate, with its 95 % interval, over each of some measures."""
    figure = Figure(figsize=(3 * len(names), 3.2), dpi=90, layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(1, len(names), sharey=True, squeeze=False)[0]
    for axis, name in zip(axes, names, strict=True):
        for model in models:
            interval = model.rates.overall.interval
            assert interval is not None
            x, y = model.measures[name], value_of(model, "overall")
            axis.plot([x, x], interval, color="#bbbbbb", linewidth=1, zorder=1)
            axis.plot(x, y, "o", color="#4c78a8", markersize=5)
            axis.annotate(model.name, (x, y), (3, 3), textcoords="offset points", fontsize=7)
        axis.set_xlabel(name)
        axis.margins(x=0.2)
        axis.grid(alpha=0.3)
    axes[0].set_ylabel("overall rate in simulation")
    figure.savefig(path)


def main(store: Path, name: str, picture: Path | None) -> None:
    """Print both tables and draw the measures that correlate most."""
    ledger = Ledger(store)
    models = models_of(ledger, resolve_sweeps(ledger, [name])[0])
    if len(models) < 4:
        raise SystemExit(f"{len(models)} models of '{name}' are validated and executed; 4 needed")
    names = shared_measures(models)
    trials = models[0].rates.overall.trials
    print(f"{len(models)} models, {trials} trials each\n\n| model | overall | valid | ", end="")
    print(" | ".join(names) + " |\n|---|---|---|" + "---|" * len(names))
    for model in models:
        told = " | ".join(f"{model.measures[name]:.3g}" for name in names)
        print(
            f"| {model.name} | {value_of(model, 'overall'):.3f} | "
            f"{value_of(model, 'valid'):.3f} | {told} |"
        )
    print("\n| measure | with overall [95 %] | p | with valid [95 %] | p |\n|---|---|---|---|---|")
    strength = {}
    for name in names:
        measure = np.array([model.measures[name] for model in models])
        found = [
            correlation(measure, np.array([value_of(model, rate) for model in models]))
            for rate in ("overall", "valid")
        ]
        strength[name] = abs(found[0].value)
        cells = [f"{c.value:+.2f} [{c.low:+.2f}, {c.high:+.2f}] | {c.p:.3f}" for c in found]
        print(f"| `{name}` | {' | '.join(cells)} |")
    if picture is not None:
        draw(models, sorted(names, key=lambda n: -strength[n])[:PICTURED], picture)


if __name__ == "__main__":
    if len(sys.argv) < 2:
        raise SystemExit(__doc__)
    given = sys.argv[2:]
    main(
        Path(sys.argv[1]),
        given[0] if given else "study",
        Path(given[1]) if len(given) > 1 else None,
    )
