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
        f"## {markdown_text(table.title)}",
        "",
        f"Sweep `{table.id}`, preset `{table.preset}`. {markdown_text(table.claim())}",
        "",
    ]
    lines += _head(head)
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
        lines += ["", "### Trials of the search", "", *_head(head)]
        lines += [markdown_row(line) for line in body]
    lines += [*_paired(table), *_seeds(table), *_new_objects(table)]
    lines += ["", "### Overall rate per object", "", *_markdown_objects(table)]
    lines += ["", "### Why grasps did not hold", "", *_markdown_reasons(table)]
    return "\n".join(lines) + "\n"


def _paired(table: SweepTable) -> list[str]:
    """Differences to the base row; nothing where there are no pairs."""
    if not any(row.paired for row in table.rows):
        return []
    base = next(row.label for row in table.rows if row.name == table.baseline)
    lines = ["", f"### Overall rate beside {markdown_text(base)}, on the same scenes", ""]
    lines += _head(["model", "difference [95 %]", "p", "p, Holm"])
    for row in table.rows:
        if row.name != table.baseline:
            text, *tests = pair_text(row.paired)
            lines.append(markdown_row([markdown_text(row.label), text, *map(markdown_text, tests)]))
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
            lines.append(markdown_row([markdown_text(row.label), *cells, seed_text(row, name)]))
    return lines


def _new_objects(table: SweepTable) -> list[str]:
    """The same rates with the wider claim."""
    lines = ["", "### Will it hold a new object?", "", markdown_text(table.claim("objects")), ""]
    lines += _head(["model", *(f"{name} ± s.e. [95 %]" for name in table.show)])
    for row in table.rows:
        cells = [rate_text(row.rate(name, "objects")) for name in table.show]
        lines.append(markdown_row([markdown_text(row.label), *cells]))
    return lines


def _markdown_objects(table: SweepTable) -> list[str]:
    names = sorted({name for row in table.rows for name in row.objects})
    lines = _head(["object", *(markdown_text(row.label) for row in table.rows)])
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


def _head(cells: list[str]) -> list[str]:
    return [markdown_row(cells), markdown_row(["---"] * len(cells))]


def markdown_row(cells: list[str]) -> str:
    """A line of a Markdown table."""
    return "| " + " | ".join(cells) + " |"


def markdown_text(text: str) -> str:
    """Text as Markdown shows it: every sign as itself."""
    return re.sub(r"([\\`*_{}\[\]<>#|$&~])", r"\\\1", one_line(text))
