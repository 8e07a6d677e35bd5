"""A table as Markdown, CSV, LaTeX, JSON, and for the terminal."""

from __future__ import annotations

import csv
import dataclasses
import io
import re
from typing import Any

from rich.table import Table
from rich.text import Text

from dmfc.report.left_out import left_out_line
from dmfc.report.rates import Rate
from dmfc.report.table import NAMES, SweepTable, TableRow
from dmfc.report.trials import trial_lines


def to_markdown(table: SweepTable) -> str:
    """The table, the per-object breakdown, and why trials failed."""
    head = ["model", "trials"]
    for name in table.show:
        head += [f"{name} ± s.e. [95 %]", "paper"]
    head += method_head(table)
    lines = [
        f"## {markdown_text(table.title)}",
        "",
        f"Sweep `{table.id}`, preset `{table.preset}`.",
        "",
    ]
    lines += [markdown_row(head), markdown_row(["---"] * len(head))]
    for row in table.rows:
        cells = [markdown_text(row.label), str(row.trials)]
        for name in table.show:
            cells += [rate_text(row.rate(name)), paper_text(row, name)]
        cells += method_cells(table, row)
        lines.append(markdown_row(cells))
    lines += ["", left_out_line(table.left_out)]
    for row in table.rows:
        if row.failure:
            lines += [
                "",
                f"**{markdown_text(row.label)}: incomplete.** {markdown_text(row.failure)}",
            ]
    if table.trials:
        head, *body = [list(map(markdown_text, line)) for line in trial_lines(table.trials)]
        lines += ["", "### Trials of the search", "", markdown_row(head)]
        lines += [markdown_row(["---"] * len(head)), *(markdown_row(line) for line in body)]
    lines += ["", "### Overall rate per object", "", *_markdown_objects(table)]
    lines += ["", "### Why grasps did not hold", "", *_markdown_reasons(table)]
    return "\n".join(lines) + "\n"


def to_csv(table: SweepTable) -> str:
    """One line per cell; empty fields where there is no figure."""
    out = io.StringIO()
    head = ["cell", "label", "seeds", "trials"]
    for name in NAMES:
        head += [f"{name}{suffix}" for suffix in ("", "_n", "_se", "_low", "_high")]
        head += [f"paper_{name}", f"paper_{name}_se"]
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow([*head, "failure", "left_out", *method_head(table)])
    left_out = "; ".join(f"{name}: {reason}" for name, reason in table.left_out.items())
    for row in table.rows:
        line: list[Any] = [row.name, row.label, row.seeds, row.trials]
        for name in NAMES:
            rate = row.rate(name)
            low, high = rate.interval or (None, None)
            line += [_number(rate.value), rate.trials, _number(rate.standard_error)]
            line += [_number(low), _number(high), *row.paper.get(name, ("", ""))]
        writer.writerow([*line, row.failure, left_out, *method_cells(table, row)])
    return out.getvalue()


def to_latex(table: SweepTable) -> str:
    """A `tabular` for booktabs: ours with the interval, the paper's in brackets."""
    lines = [
        f"% {_one_line(table.title)}; sweep {table.id}, preset {table.preset}",
        f"% {_one_line(left_out_line(table.left_out))}",
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
        "cells": {row.name: _json_row(row) for row in table.rows},
        "left_out": dict(table.left_out),
        "search": {trial.name: dataclasses.asdict(trial) for trial in table.trials},
    }


def to_rich(table: SweepTable) -> Table:
    """The table for the terminal."""
    title = Text(f"{table.title} ({table.preset})", style="table.title")
    shown = Table(title=title, title_justify="left")
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
            cells += [rate_text(row.rate(name)).replace(" [", "\n["), paper_text(row, name)]
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
        "rates": {name: _json_rate(row.rate(name)) for name in NAMES},
        "paper": {name: list(pair) for name, pair in row.paper.items()},
        "objects": {
            obj: {name: _json_rate(getattr(found, name)) for name in NAMES}
            for obj, found in row.objects.items()
        },
        "reasons": dict(row.reasons),
        **({"method": dataclasses.asdict(row.method)} if row.method else {}),
    }


def _json_rate(rate: Rate) -> dict[str, Any]:
    return {
        "value": rate.value,
        "n": rate.trials,
        "standard_error": rate.standard_error,
        "interval": list(rate.interval) if rate.interval else None,
    }


def _markdown_objects(table: SweepTable) -> list[str]:
    names = sorted({name for row in table.rows for name in row.objects})
    lines = [markdown_row(["object", *(markdown_text(row.label) for row in table.rows)])]
    lines.append(markdown_row(["---"] * (len(table.rows) + 1)))
    for name in names:
        cells = [markdown_text(name)]
        for row in table.rows:
            found = row.objects.get(name)
            has = found is not None and found.overall.value is not None
            cells.append(f"{found.overall.value:.2f} ({found.overall.trials})" if has else "–")  # type: ignore[union-attr]
        lines.append(markdown_row(cells))
    return lines


def _markdown_reasons(table: SweepTable) -> list[str]:
    lines = []
    for row in table.rows:
        counts = ", ".join(f"{reason} {count}" for reason, count in row.reasons.items())
        lines.append(f"- **{markdown_text(row.label)}**: {markdown_text(counts) or 'all held'}")
    return lines


def markdown_row(cells: list[str]) -> str:
    """A line of a Markdown table."""
    return "| " + " | ".join(cells) + " |"


def markdown_text(text: str) -> str:
    """Text as Markdown shows it: every sign as itself."""
    return re.sub(r"([\\`*_{}\[\]<>#|$&~])", r"\\\1", _one_line(text))


def _one_line(text: str) -> str:
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
    return "".join(LATEX.get(sign, sign) for sign in _one_line(text))


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:.6f}"
