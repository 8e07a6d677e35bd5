"""`dmfc config`: every setting, what it means, its value here, and where that came from."""

from __future__ import annotations

import shutil
from typing import Annotated

import typer

from dmfc.cli import complete
from dmfc.cli.common import AsJson, Overrides, Preset
from dmfc.experiment.console import answer


def config(
    selector: Annotated[
        str,
        typer.Argument(
            metavar="[KEY|GROUP]",
            help="A setting or a group such as training.finetune; default: all.",
            autocompletion=complete.keys,
        ),
    ] = "",
    preset: Preset = [],  # noqa: B006
    overrides: Overrides = None,
    diff: Annotated[
        bool, typer.Option("--diff", help="Only settings that differ from their defaults.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Print settings: meaning, range, default, value, and where the value came from."""
    from dmfc.config import reference

    rows = reference.described(preset, overrides or [], selector)
    if diff:
        rows = [row for row in rows if row.changed]
    if as_json:
        answer(reference.as_json(rows))
        return
    for line in reference.as_text(rows, min(100, shutil.get_terminal_size().columns)):
        typer.echo(line)
    if not rows:
        typer.echo("no setting differs from its default")
