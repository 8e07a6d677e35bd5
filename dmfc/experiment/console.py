"""Printing: messages on standard error, answers on standard output."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import typer

if TYPE_CHECKING:
    from rich.console import Console


def stderr() -> Console:
    """The console for people; standard output is for answers."""
    from rich.console import Console

    return Console(stderr=True, highlight=False)


def warn(warnings: Iterable[str]) -> None:
    """Print the warnings that are not empty on standard error, a line each."""
    for warning in warnings:
        if warning:
            stderr().print(f"warning: {warning}", soft_wrap=True, markup=False)


def answer(value: Any) -> None:
    """Print JSON for a machine."""
    typer.echo(json.dumps(value, indent=2, sort_keys=False, default=str))


def show_rows(title: str, rows: Sequence[Mapping[str, Any]], as_json: bool) -> None:
    """Print rows with equal columns as a table, or as a JSON list."""
    if as_json:
        answer(list(rows))
        return
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    table = Table(title=title, title_justify="left")
    for name in rows[0] if rows else ("nothing",):
        table.add_column(str(name).replace("_", " "))
    for row in rows:
        table.add_row(*(Text(_text(value)) for value in row.values()))
    console = Console(highlight=False)
    if (
        not console.is_terminal
    ):  # a pipe has no width; cutting columns would lose what was asked for
        console.width = 200
    console.print(table)


def _text(value: Any) -> str:
    if value is None:
        return ""
    return f"{value:.4g}" if isinstance(value, float) else str(value)
