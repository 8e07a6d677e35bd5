"""Options and output that the commands share."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from dmfc.cli import complete
from dmfc.cli.outputs import folder_to_read
from dmfc.errors import DmfcError
from dmfc.experiment.console import stderr

Preset = Annotated[
    list[str],
    typer.Option(
        "--preset",
        help="Settings to start from: smoke, quick, medium, full, literal, or a YAML file. "
        "Repeatable: the last one wins.",
        autocompletion=complete.presets,
    ),
]
Overrides = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        help="key=value over the preset, for example training.seed=1 (`dmfc config` lists the "
        "keys). Repeatable.",
        autocompletion=complete.overrides,
    ),
]
Store = Annotated[
    Path,
    typer.Option(
        "--store",
        envvar="DMFC_STORE",
        help="Folder of finished stages and results.",
        callback=folder_to_read(),
    ),
]
OverOption = Annotated[
    Literal["scenes", "objects"],
    typer.Option(
        "--over",
        help="What the intervals hold for: new scenes of the same objects, or new objects.",
    ),
]
AsJson = Annotated[bool, typer.Option("--json", help="Answer with JSON on standard output.")]

Port = Annotated[int, typer.Option(min=0, max=65535, help="Port to listen on; 0 takes a free one.")]


def number(above: float = -math.inf, least: float = -math.inf) -> Callable[..., float | None]:
    """A callback for an option of a finite number, more than `above` and not less than `least`."""

    def check(param: typer.CallbackParam, value: float | None) -> float | None:
        if value is not None and not (math.isfinite(value) and value > above and value >= least):
            limit = f" above {above:g}" if above > -math.inf else ""
            limit += f" of at least {least:g}" if least > -math.inf else ""
            raise DmfcError(f"{param.opts[0]} {value}: a finite number{limit} is needed")
        return value

    return check


PRESET = ["quick"]
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
