"""What the verbs share: options, the console, and running stages for a person who watches."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from dmfc.experiment.console import stderr

if TYPE_CHECKING:
    pass

Preset = Annotated[
    str,
    typer.Option(
        "--preset", help="Settings to start from: smoke, quick, hour, paper, or a YAML file."
    ),
]
Overrides = Annotated[
    list[str] | None,
    typer.Option(
        "--set", help="key=value over the preset, for example training.seed=1. Repeatable."
    ),
]
Store = Annotated[
    Path,
    typer.Option("--store", envvar="DMFC_STORE", help="Folder of finished stages and results."),
]
AsJson = Annotated[bool, typer.Option("--json", help="Answer with JSON on standard output.")]

PRESET = "quick"
STORE = Path("store")


def with_failures(
    names: Sequence[str],
    rows: Mapping[str, Mapping[str, Any]],
    failed: Mapping[str, str],
    columns: Sequence[str] = ("object",),
) -> list[dict[str, Any]]:
    """A row per object: what is known of it, or nothing (None) and the reason of its failure.

    `columns`: the first ones, which are there even if every object failed.
    """
    empty = dict.fromkeys([*columns, *(column for row in rows.values() for column in row)])
    return [
        {**empty, "object": name, **rows.get(name, {}), "failure": failed.get(name)}
        for name in names
    ]


def end_if_failed(failed: Mapping[str, str], of: int) -> None:
    """End the program with status 1, after saying so, if any of so many objects failed."""
    if failed:
        stderr().print(f"{len(failed)} of {of} objects failed, see the column failure")
        raise typer.Exit(1)
