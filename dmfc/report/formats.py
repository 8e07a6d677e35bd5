"""A table as CSV, LaTeX, JSON, and for the terminal."""

from __future__ import annotations

import csv
import dataclasses
import io
import math
from typing import Any

from rich.table import Table
from rich.text import Text

from dmfc.report.left_out import left_out_line
from dmfc.report.paired import Comparison
from dmfc.report.rates import Over, Rate, Rates
from dmfc.report.table import NAMES, SweepTable, TableRow

OVER: tuple[Over, ...] = ("scenes", "objects")
SUFFIXES = ("", "_n", "_se", "_low", "_high", "_objects_low", "_objects_high", "_seed_sd")
"""Of the columns of a rate."""
PAIRED = ("difference", "difference_low", "difference_high", "p", "p_holm")
"""Columns of the difference of the overall rate to the base row."""


def to_csv(table: SweepTable) -> str:
    """One line per cell; empty fields where there is no figure."""
    out = io.StringIO()
    head = ["cell", "label", "seeds", "trials"]
    for name in NAMES:
        head += [f"{name}{suffix}" for suffix in SUFFIXES]
        head += [f"paper_{name}", f"paper_{name}_se"]
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(
        [*head, *PAIRED, "failure", "left_out", "claim", "claim_objects", *method_head(table)]
    )
    claims = [table.claim("scenes"), table.claim("objects")]
    left_out = "; ".join(f"{name}: {reason}" for name, reason in (table.left_out or {}).items())
    for row in table.rows:
        line: list[Any] = [row.name, row.label, row.seeds, row.trials]
        for name in NAMES:
            rate = row.rate(name)
            low, high = rate.interval or (None, None)
            wide_low, wide_high = row.rate(name, "objects").interval or (None, None)
            line += [_number(rate.value), rate.trials, _number(rate.standard_error)]
            line += map(_number, (low, high, wide_low, wide_high, _known(row.seed_spread(name))))
            line += row.paper.get(name, ("", ""))
        pair = row.paired
        line += map(_number, (pair.difference, pair.low, pair.high) if pair else [None] * 3)
        line += [f"{pair.p:.6g}", f"{pair.p_holm:.6g}"] if pair else ["", ""]
        writer.writerow([*line, row.failure, left_out, *claims, *method_cells(table, row)])
    return out.getvalue()


def to_latex(table: SweepTable) -> str:
    """A `tabular` for booktabs: ours with the interval, the paper's in brackets."""
    lines = [
        f"% {one_line(table.title)}; sweep {table.id}, preset {table.preset}",
        f"% {table.claim()}",
        f"% {one_line(left_out_line(table.left_out))}",
        rf"\begin{{tabular}}{{lr{'l' * len(table.show)}}}",
        r"\toprule",
        " & ".join(["model", "$n$", *table.show]) + r" \\",
        r"\midrule",
    ]
    for row in table.rows:
        cells = [_latex(row.label), str(row.trials)]
        cells += [_latex_rate(row, name) for name in table.show]
        lines.append(" & ".join(cells) + r" \\")
    return "\n".join([*lines, r"\bottomrule", r"\end{tabular}"]) + "\n"


def to_json(table: SweepTable) -> dict[str, Any]:
    """The table for a machine."""
    return {
        "id": table.id,
        "name": table.name,
        "title": table.title,
        "preset": table.preset,
        "show": list(table.show),
        "baseline": table.baseline,
        "claims": {over: table.claim(over) for over in OVER},
        "order": [row.name for row in table.rows],
        "cells": {row.name: _json_row(row) for row in table.rows},
        "left_out": None if table.left_out is None else dict(table.left_out),
        "search": {trial.name: dataclasses.asdict(trial) for trial in table.trials},
    }


def to_rich(table: SweepTable, over: Over = "scenes") -> Table:
    """The table for the terminal, with intervals `over` new scenes or new objects."""
    title = Text(f"{table.title} ({table.preset})", style="table.title")
    caption = Text(table.claim(over), style="table.caption")
    shown = Table(title=title, title_justify="left", caption=caption, caption_justify="left")
    shown.add_column("model")
    shown.add_column("n", justify="right")
    for name in table.show:
        shown.add_column(f"{name} ± s.e.\n[95 %]")
        shown.add_column("paper")
    for name in method_head(table):
        shown.add_column(name, justify="right")
    for row in table.rows:
        cells = [row.label, str(row.trials)]
        for name in table.show:
            cells += [rate_text(row.rate(name, over)).replace(" [", "\n["), paper_text(row, name)]
        cells += method_cells(table, row)
        shown.add_row(*map(Text, cells))
    return shown


def method_head(table: SweepTable) -> list[str]:
    """Columns that a table has where somebody else's method is in it."""
    there = any(row.method for row in table.rows)
    return ["s per scene", "failed scenes", "used"] if there else []


def method_cells(table: SweepTable, row: TableRow) -> list[str]:
    """The cells of a row under `method_head`; empty for rows of our own."""
    method = row.method
    if method is None:
        return [""] * len(method_head(table))
    seconds = "" if method.seconds is None else f"{method.seconds:.3g}"
    return [seconds, str(method.failed_scenes), method.used]


def rate_text(rate: Rate) -> str:
    """'0.50 ± 0.03 [0.44, 0.56]', or a dash where there were no trials."""
    interval = rate.interval
    if rate.value is None or interval is None:
        return "–"
    return f"{rate.value:.2f} ± {rate.standard_error:.2f} [{interval[0]:.2f}, {interval[1]:.2f}]"


def pair_text(pair: Comparison | None) -> tuple[str, str, str]:
    """'+0.16 [+0.08, +0.23]', p and p by Holm; dashes where there are no pairs."""
    if pair is None:
        return "–", "–", "–"
    text = f"{pair.difference:+.2f} [{pair.low:+.2f}, {pair.high:+.2f}]"
    return text, p_text(pair.p), p_text(pair.p_holm)


def p_text(p: float) -> str:
    """'0.03', '0.0004', and '<0.0001' for less."""
    if p < 1e-4:
        return "<0.0001"
    return f"{p:.2f}" if p >= 0.1 else f"{p:.1g}"


def seed_text(row: TableRow, name: str) -> str:
    """'0.55 ± 0.03': mean and standard deviation of a rate over the seeds."""
    value, spread = row.rate(name).value, row.seed_spread(name)
    if value is None:
        return "–"
    return f"{value:.2f}" + ("" if math.isnan(spread) else f" ± {spread:.2f}")


def paper_text(row: TableRow, name: str) -> str:
    """The paper's figure as printed there; empty where it has none."""
    if name not in row.paper:
        return ""
    value, error = row.paper[name]
    return f"{value:g} ± {error:g}"


def _json_row(row: TableRow) -> dict[str, Any]:
    return {
        "label": row.label,
        "seeds": row.seeds,
        "trials": row.trials,
        "failure": row.failure or None,
        "rates": _json_rates(row.rates),
        "rates_new_objects": _json_rates(row.new_objects),
        "by_seed": {str(seed): _json_rates(found) for seed, found in row.by_seed.items()},
        "seed_spread": {name: _known(row.seed_spread(name)) for name in NAMES},
        "paired": row.paired.row() if row.paired else None,
        "paper": {name: list(pair) for name, pair in row.paper.items()},
        "objects": {obj: _json_rates(found) for obj, found in row.objects.items()},
        "reasons": dict(row.reasons),
        **({"method": dataclasses.asdict(row.method)} if row.method else {}),
    }


def _json_rates(found: Rates) -> dict[str, Any]:
    return {name: _json_rate(getattr(found, name)) for name in NAMES}


def _json_rate(rate: Rate) -> dict[str, Any]:
    return {
        "value": rate.value,
        "n": rate.trials,
        "effective_n": None if rate.value is None else rate.worth,
        "standard_error": rate.standard_error,
        "interval": list(rate.interval) if rate.interval else None,
    }


def one_line(text: str) -> str:
    return " ".join(text.split())


def _latex_rate(row: TableRow, name: str) -> str:
    rate, interval = row.rate(name), row.rate(name).interval
    if rate.value is None or interval is None:
        return "--"
    paper = f" ({row.paper[name][0]:g})" if name in row.paper else ""
    low, high = interval
    return f"${rate.value:.2f} \\pm {rate.standard_error:.2f}$ [{low:.2f}, {high:.2f}]{paper}"


LATEX = {
    **{sign: f"\\{sign}" for sign in "&%$#_{}"},
    "\\": r"\textbackslash{}",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    "<": r"\textless{}",
    ">": r"\textgreater{}",
    "|": r"\textbar{}",
}
"""Signs that mean something to LaTeX, as it prints them."""


def _latex(text: str) -> str:
    return "".join(LATEX.get(sign, sign) for sign in one_line(text))


def _known(value: float) -> float | None:
    return None if math.isnan(value) else value


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:.6f}"
