"""The trials of a search: what was tried, what validation said of it, which was the best."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from rich.table import Table
from rich.text import Text

from dmfc.engine.ledger import Ledger
from dmfc.sweep.record import SearchRecord, SweepRecord
from dmfc.sweep.search import measures_of, objective_of


@dataclass(frozen=True)
class SearchTrial:
    """One trial over all seeds; `value` is the objective, None where it failed or is not done."""

    name: str
    settings: Mapping[str, Any]
    value: float | None
    best: bool = False
    measures: Mapping[str, float] = field(default_factory=dict)
    """What the objective is made of, each a mean over the seeds."""
    failure: str = ""


def read_trials(
    ledger: Ledger, sweep: SweepRecord, failures: Mapping[str, str]
) -> list[SearchTrial]:
    """The trials of a sweep as the ledger holds them; empty for a sweep that is no search."""
    search = sweep.search
    if search is None:
        return []
    models: dict[str, list[str]] = {}
    for cell in sweep.cells:
        if cell.objective and cell.model:
            models.setdefault(cell.name, []).append(cell.model)
    return [
        _trial(ledger, name, models[name], place, search, failures)
        for place, name in enumerate(models)
    ]


def trial_lines(trials: Sequence[SearchTrial]) -> list[list[str]]:
    """The head, then a line per trial: settings, measures, objective, remark."""
    settings = list(trials[0].settings)
    measures = list(dict.fromkeys(name for trial in trials for name in trial.measures))
    lines = [["trial", *(name.rpartition(".")[2] for name in settings), *measures]]
    lines[0] += ["objective", ""]
    for trial in trials:
        line = [trial.name, *(_text(trial.settings[name]) for name in settings)]
        line += [_text(trial.measures.get(name)) for name in measures]
        lines.append([*line, _text(trial.value), "best" if trial.best else trial.failure])
    return lines


def trials_to_csv(trials: Sequence[SearchTrial]) -> str:
    """As `trial_lines`, with whole names and numbers."""
    settings = list(trials[0].settings)
    measures = list(dict.fromkeys(name for trial in trials for name in trial.measures))
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(["trial", *settings, *measures, "objective", "best", "failure"])
    for trial in trials:
        line = [trial.name, *trial.settings.values(), *(trial.measures.get(n) for n in measures)]
        writer.writerow([*line, trial.value, int(trial.best), trial.failure])
    return out.getvalue()


def trials_to_rich(trials: Sequence[SearchTrial]) -> Table:
    """The trials for the terminal."""
    head, *body = trial_lines(trials)
    shown = Table(title="Trials of the search", title_justify="left")
    for name in head:
        shown.add_column(Text(name))
    for line, trial in zip(body, trials, strict=True):
        shown.add_row(*map(Text, line), style="bold" if trial.best else "")
    return shown


def _trial(
    ledger: Ledger,
    name: str,
    models: Sequence[str],
    place: int,
    search: SearchRecord,
    failures: Mapping[str, str],
) -> SearchTrial:
    settings, best = search.trials[place], search.best == place
    missing = [model for model in models if not ledger.finished(model)]
    if missing:
        reason = failures.get(missing[0], "not run yet")
        return SearchTrial(name, settings, None, best, failure=reason)
    values = [objective_of(ledger, model, search.objective) for model in models]
    found = [measures_of(ledger, model) for model in models]
    means = {
        measure: sum(each[measure] for each in found) / len(found)
        for measure in search.objective
        if all(measure in each for each in found)
    }
    known = [value for value in values if value is not None]
    if len(known) < len(values):
        return SearchTrial(name, settings, None, best, means, "validation measured no number")
    return SearchTrial(name, settings, sum(known) / len(known), best, means)


def _text(value: Any) -> str:
    if value is None:
        return "–"
    return f"{value:.4g}" if isinstance(value, float) else str(value)
