"""A sweep as one page of HTML that needs nothing else: table, figures, tests, what made it."""

from __future__ import annotations

import base64
import shlex
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from functools import cache
from pathlib import Path
from typing import Any

from dmfc.engine.ledger import Ledger
from dmfc.engine.provenance import VECTOR_FLAGS, read_provenance
from dmfc.engine.stage import differences
from dmfc.engine.state import SEALED_VERSION, read_state
from dmfc.errors import masked
from dmfc.files.atomic import write_text
from dmfc.files.sealed import read_or_replace
from dmfc.report.clusters import CONFIDENCE
from dmfc.report.curves import draw_curves
from dmfc.report.diagnosed import diagnosed
from dmfc.report.failures import draw_failures
from dmfc.report.figure import draw_rates
from dmfc.report.formats import method_cells, method_head, p_text, paper_text, rate_text, seed_text
from dmfc.report.left_out import left_out_line
from dmfc.report.outputs import note_outputs
from dmfc.report.over import draw_over
from dmfc.report.rates import Rate
from dmfc.report.table import NAMES, SweepTable, TableRow
from dmfc.report.trial_figure import draw_trials
from dmfc.report.trials import trial_lines
from dmfc.sweep.record import SweepRecord

PAGE = "table.html"
MARKER = "tracked.json"
"""Where tracking says which run is which (written there, read here)."""
UI = "http://127.0.0.1:5000"
"""Where `dmfc ui` serves runs that are in no server of their own."""
RATES_CAPTION = "The rates with their 95 % intervals"
OVER_CAPTION = "The overall rate over single settings"
CURVES_CAPTION = "Training loss per epoch"
CHANGES = 6
"""Settings named per cell; of more only the number."""


@dataclass(frozen=True)
class Origin:
    """What made a table: all that a page says of it besides the rates."""

    status: str
    calls: Sequence[Mapping[str, Any]]
    """Of the commands that ran stages of it, as `provenance.json` has them."""
    tracked: Mapping[str, Any] = field(default_factory=dict)
    settings: Sequence[Mapping[str, Any]] = ()
    """Each cell's stages, and how its settings differ from those of the first."""
    diagnosed: Mapping[str, Any] = field(default_factory=dict)
    """What fine-tuning did to its predictions (`dmfc.report.diagnosed`)."""


def write_page(
    ledger: Ledger,
    sweep: SweepRecord,
    table: SweepTable,
    figures: Sequence[Mapping[str, str]],
) -> Path:
    """Write `table.html` with `figures` (of `draw_figures`) into the sweep's folder."""
    folder = ledger.store / "sweeps" / table.id
    path = folder / PAGE
    write_text(path, page_text(table, figures, origin_of(ledger, sweep)))
    note_outputs(folder, [PAGE])
    return path


def origin_of(ledger: Ledger, sweep: SweepRecord) -> Origin:
    """What the store knows of a sweep."""
    folder = ledger.store / "sweeps" / sweep.id
    calls = [
        {**call, "command": [*map(masked, call["command"])]} for call in read_provenance(folder)
    ]
    return Origin(
        read_state(folder).status,
        calls,
        read_marker(folder),
        _settings(sweep),
        diagnosed(ledger, sweep),
    )


def page_text(table: SweepTable, figures: Sequence[Mapping[str, str]], origin: Origin) -> str:
    """The page as HTML."""
    tracked = origin.tracked
    base = [row.label for row in table.rows if row.name == table.baseline]
    return _template().render(
        table=table,
        status=origin.status,
        baseline_label=base[0] if base else "",
        rows=[_row(row, table, tracked) for row in table.rows],
        seeds=_seeds(table),
        tracked=bool(tracked),
        served=_server(tracked) == UI,
        left_out=left_out_line(table.left_out),
        has_paper=any(row.paper for row in table.rows),
        method_head=method_head(table),
        figures=figures,
        trials=_searched(table, tracked),
        objects=_objects(table),
        reasons=_reasons(table),
        diagnosed=origin.diagnosed,
        calls=[_call(call) for call in origin.calls],
        settings=origin.settings,
    )


def read_marker(folder: Path) -> dict[str, Any]:
    """Where tracking has the sweep of that folder; empty if nowhere, or if that is damaged."""
    return read_or_replace(folder / MARKER, SEALED_VERSION) or {}


def draw_figures(ledger: Ledger, sweep: SweepRecord, table: SweepTable) -> list[dict[str, str]]:
    """Draw `table.png` and `curves.png` into the sweep's folder; all figures as text for a page."""
    folder = ledger.store / "sweeps" / table.id
    draw_rates(table, folder / "table.png")
    drawn = [(RATES_CAPTION, folder / "table.png")]
    if table.trials:
        draw_trials(table.trials, folder / "search.png")
        drawn.append(("Trials of the search: objective by setting", folder / "search.png"))
    if draw_over(table, sweep, folder / "over.png"):
        drawn.append((OVER_CAPTION, folder / "over.png"))
    if draw_curves(ledger, sweep, folder / "curves.png"):
        drawn.append((CURVES_CAPTION, folder / "curves.png"))
    note_outputs(folder, [path.name for _, path in drawn])
    return as_text(table, drawn)


def as_text(table: SweepTable, drawn: Sequence[tuple[str, Path]]) -> list[dict[str, str]]:
    """Figures for a page: those `drawn`, each with its caption, and that of the reasons."""
    with tempfile.TemporaryDirectory() as temporary:
        path = Path(temporary) / "reasons.png"
        draw_failures(table, path)
        every = [*drawn[:1], ("What became of each executed grasp", path), *drawn[1:]]
        return [
            {"alt": alt, "data": base64.b64encode(path.read_bytes()).decode()}
            for alt, path in every
        ]


@cache
def _template() -> Any:
    from jinja2 import Environment, StrictUndefined

    source = Path(__file__).with_name("page.html").read_text(encoding="utf-8")
    return Environment(autoescape=True, undefined=StrictUndefined).from_string(source)


def _row(row: TableRow, table: SweepTable, tracked: Mapping[str, Any]) -> dict[str, Any]:
    return {
        "label": row.label,
        "trials": row.trials,
        "failure": row.failure,
        "rates": [_rate(row, name) for name in table.show],
        "paired": _paired(row, table),
        "method": method_cells(table, row),
        "runs": _runs(row.name, list(row.by_seed), tracked),
    }


def _runs(cell: str, seeds: Sequence[int], tracked: Mapping[str, Any]) -> list[dict[str, str]]:
    """Links to a cell's runs in MLflow, those that are there."""
    known = tracked.get("runs", {})
    runs = f"{_server(tracked)}/#/experiments/{tracked.get('experiment_id')}/runs"
    return [
        {"name": f"seed {seed}", "url": f"{runs}/{known[name]}"}
        for seed in seeds
        if (name := f"{cell}-seed{seed}") in known
    ]


def _server(tracked: Mapping[str, Any]) -> str:
    """Address of the pages of the runs."""
    uri = str(tracked.get("uri", ""))
    return uri.rstrip("/") if uri.startswith(("http://", "https://")) else UI


def _searched(table: SweepTable, tracked: Mapping[str, Any]) -> dict[str, Any]:
    """Head and lines of the search's table; empty where there was none."""
    if not table.trials:
        return {}
    head, *lines = trial_lines(table.trials)
    rows = [
        {"cells": line, "best": trial.best, "runs": _runs(trial.name, table.seeds, tracked)}
        for line, trial in zip(lines, table.trials, strict=True)
    ]
    return {"head": head, "rows": rows}


def _rate(row: TableRow, name: str) -> dict[str, str]:
    rate, paper = row.rate(name), paper_text(row, name)
    if rate.value is None or rate.interval is None:
        nothing = {"text": "–", "interval": "", "objects": "", "difference": "", "sign": ""}
        return {**nothing, "paper": paper}
    low, high = rate.interval
    difference, sign = "", ""
    if name in row.paper:
        value = row.paper[name][0]
        difference = f"{rate.value - value:+.2f}"
        # Coloured only where the paper's figure is outside our interval.
        sign = "worse" if high < value else "better" if low > value else ""
    return {
        "text": f"{rate.value:.2f} ± {rate.standard_error:.2f}",
        "interval": f"[{low:.2f}, {high:.2f}]",
        "objects": "[{:.2f}, {:.2f}]".format(*(row.rate(name, "objects").interval or (0, 1))),
        "paper": paper,
        "difference": difference,
        "sign": sign,
    }


def _paired(row: TableRow, table: SweepTable) -> dict[str, str]:
    """The difference to the base row over the same trials; empty where there are no pairs."""
    found = row.paired
    if found is None:
        text = "base" if row.name == table.baseline else ""
        return {"text": text, "interval": "", "p": "", "holm": "", "sign": ""}
    sign = ""
    if found.p_holm < 1 - CONFIDENCE:
        sign = "better" if found.difference > 0 else "worse"
    return {
        "text": f"{found.difference:+.2f}",
        "interval": f"[{found.low:+.2f}, {found.high:+.2f}]",
        "p": p_text(found.p),
        "holm": f"Holm {p_text(found.p_holm)}",
        "sign": sign,
    }


def _seeds(table: SweepTable) -> list[dict[str, Any]]:
    """Rates of each training seed, their mean and spread; empty where there is one seed."""
    if len(table.seeds) < 2:
        return []
    lines = []
    for row in table.rows:
        cells = []
        for seed in table.seeds:
            found = row.by_seed.get(seed)
            cells.append([rate_text(getattr(found, name)) if found else "–" for name in table.show])
        spread = [seed_text(row, name) for name in table.show]
        lines.append({"label": row.label, "cells": cells, "spread": spread})
    return lines


def _objects(table: SweepTable) -> list[dict[str, Any]]:
    names = sorted({name for row in table.rows for name in row.objects})

    def cell(row: TableRow, name: str) -> dict[str, Any]:
        rate = row.objects[name].overall if name in row.objects else Rate(0, 0)
        if rate.value is None:
            return {"value": None, "text": "", "title": ""}
        text = f"{rate.value:.2f} ({rate.trials})"
        parts = [f"{kind} {rate_text(getattr(row.objects[name], kind))}" for kind in NAMES]
        return {"value": rate.value, "text": text, "title": "; ".join(parts)}

    return [{"name": name, "cells": [cell(row, name) for row in table.rows]} for name in names]


def _reasons(table: SweepTable) -> list[dict[str, Any]]:
    totals: dict[str, int] = {}
    for row in table.rows:
        for name, count in row.reasons.items():
            totals[name] = totals.get(name, 0) + count
    ordered = sorted(totals, key=lambda name: (-totals[name], name))
    return [
        {"name": name, "counts": [row.reasons.get(name, 0) for row in table.rows]}
        for name in ordered
    ]


def _call(call: Mapping[str, Any]) -> dict[str, Any]:
    started = datetime.fromtimestamp(call["started"], UTC).strftime("%Y-%m-%d %H:%M:%S UTC")
    vector = (flag for flag in call["flags"].split() if flag.startswith(VECTOR_FLAGS))
    told = {"line": masked(shlex.join(["dmfc", *call["command"]])), "vector": " ".join(vector)}
    return {"diff": None, **call, "started": started, **told}


def _settings(sweep: SweepRecord) -> list[dict[str, Any]]:
    """Each cell's stages, and how its settings differ from those of the first."""
    first = sweep.cells[0].config
    described = []
    for cell in sweep.cells:
        changes = list(differences(first, cell.config))
        shown = "; ".join(changes[:CHANGES])
        more = f"; and {len(changes) - CHANGES} more" if len(changes) > CHANGES else ""
        described.append(
            {
                "label": f"{cell.label}, seed {cell.seed}",
                "changes": shown + more,
                "stages": cell.stages,
            }
        )
    return described
