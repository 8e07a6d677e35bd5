"""A table as Markdown, and in all formats that are text."""

from __future__ import annotations

import re

from dmfc.report.formats import (
    method_cells,
    method_head,
    one_line,
    pair_text,
    paper_text,
    rate_text,
    seed_text,
    to_csv,
    to_latex,
)
from dmfc.report.left_out import left_out_line
from dmfc.report.table import SweepTable
from dmfc.report.trials import trial_lines


def texts(table: SweepTable) -> dict[str, str]:
    """The table in each format that is text, by the end of its file's name."""
    return {"md": to_markdown(table), "csv": to_csv(table), "tex": to_latex(table)}


def to_markdown(table: SweepTable) -> str:
    """The table, the per-object breakdown, and why trials failed."""
    head = ["model", "trials"]
    for name in table.show:
        head += [f"{name} ± s.e. [95 %]", "paper"]
    head += method_head(table)
    lines = [
        f"## {_markdown(table.title)}",
        "",
        f"Sweep `{table.id}`, preset `{table.preset}`. {_markdown(table.claim())}",
        "",
    ]
    lines += _head(head)
    for row in table.rows:
        cells = [_markdown(row.label), str(row.trials)]
        for name in table.show:
            cells += [rate_text(row.rate(name)), paper_text(row, name)]
        cells += method_cells(table, row)
        lines.append(_markdown_row(cells))
    lines += ["", left_out_line(table.left_out)]
    for row in table.rows:
        if row.failure:
            lines += ["", f"**{_markdown(row.label)}: incomplete.** {_markdown(row.failure)}"]
    if table.trials:
        head, *body = [list(map(_markdown, line)) for line in trial_lines(table.trials)]
        lines += ["", "### Trials of the search", "", *_head(head)]
        lines += [_markdown_row(line) for line in body]
    lines += [*_paired(table), *_seeds(table), *_new_objects(table)]
    lines += ["", "### Overall rate per object", "", *_markdown_objects(table)]
    lines += ["", "### Why grasps did not hold", "", *_markdown_reasons(table)]
    return "\n".join(lines) + "\n"


def _paired(table: SweepTable) -> list[str]:
    """Differences to the base row; nothing where there are no pairs."""
    if not any(row.paired for row in table.rows):
        return []
    base = next(row.label for row in table.rows if row.name == table.baseline)
    lines = ["", f"### Overall rate beside {_markdown(base)}, on the same scenes", ""]
    lines += _head(["model", "difference [95 %]", "p", "p, Holm"])
    for row in table.rows:
        if row.name != table.baseline:
            text, *tests = pair_text(row.paired)
            lines.append(_markdown_row([_markdown(row.label), text, *map(_markdown, tests)]))
    lines += ["", "p, Holm: corrected for the number of rows."]
    return lines


def _seeds(table: SweepTable) -> list[str]:
    """Each training seed; nothing where there is one."""
    seeds = table.seeds
    if len(seeds) < 2:
        return []
    lines = []
    for name in table.show:
        lines += ["", f"### {name.capitalize()} rate of each training seed", ""]
        lines += _head(["model", *(f"seed {seed}" for seed in seeds), "mean ± s.d."])
        for row in table.rows:
            found = [row.by_seed.get(seed) for seed in seeds]
            values = [getattr(rates, name).value if rates else None for rates in found]
            cells = ["–" if value is None else f"{value:.2f}" for value in values]
            lines.append(_markdown_row([_markdown(row.label), *cells, seed_text(row, name)]))
    return lines


def _new_objects(table: SweepTable) -> list[str]:
    """The same rates with the wider claim."""
    lines = ["", "### Will it hold a new object?", "", _markdown(table.claim("objects")), ""]
    lines += _head(["model", *(f"{name} ± s.e. [95 %]" for name in table.show)])
    for row in table.rows:
        cells = [rate_text(row.rate(name, "objects")) for name in table.show]
        lines.append(_markdown_row([_markdown(row.label), *cells]))
    return lines


def _markdown_objects(table: SweepTable) -> list[str]:
    names = sorted({name for row in table.rows for name in row.objects})
    lines = _head(["object", *(_markdown(row.label) for row in table.rows)])
    for name in names:
        cells = [_markdown(name)]
        for row in table.rows:
            found = row.objects.get(name)
            has = found is not None and found.overall.value is not None
            cells.append(f"{found.overall.value:.2f} ({found.overall.trials})" if has else "–")  # type: ignore[union-attr]
        lines.append(_markdown_row(cells))
    return lines


def _markdown_reasons(table: SweepTable) -> list[str]:
    lines = []
    for row in table.rows:
        counts = ", ".join(f"{reason} {count}" for reason, count in row.reasons.items())
        lines.append(f"- **{_markdown(row.label)}**: {_markdown(counts) or 'all held'}")
    return lines


def _head(cells: list[str]) -> list[str]:
    return [_markdown_row(cells), _markdown_row(["---"] * len(cells))]


def _markdown_row(cells: list[str]) -> str:
    return "| " + " | ".join(cells) + " |"


def _markdown(text: str) -> str:
    """Text as Markdown shows it: every sign as itself."""
    return re.sub(r"([\\`*_{}\[\]<>#|$&~])", r"\\\1", one_line(text))
