"""What the verbs share: options, the console, and running stages for a person who watches."""

from __future__ import annotations

import contextlib
import json
import shlex
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from dmfc.errors import DmfcError

if TYPE_CHECKING:
    from rich.console import Console

    from dmfc.config.schema import Config
    from dmfc.engine.engine import Outcomes, Watcher
    from dmfc.pipeline.graph import GraphBuilder
    from dmfc.engine.ledger import Ledger
    from dmfc.engine.stage import Stage

INTERRUPTED = 130
"""Exit status after Ctrl-C, as shells have it."""

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


@dataclass(frozen=True)
class Session:
    """The settings and the store that one call works with."""

    config: Config
    ledger: Ledger
    builder: GraphBuilder

    @classmethod
    def open(
        cls,
        preset: str,
        overrides: Sequence[str] | None,
        store: Path,
        grasp_files: Mapping[str, Path] | None = None,
    ) -> Session:
        """`grasp_files`: see `GraphBuilder`."""
        from dmfc.config.load import load_config
        from dmfc.pipeline.graph import GraphBuilder
        from dmfc.engine.ledger import Ledger
        from dmfc.pipeline.selection import list_refs

        config = load_config(preset, overrides or [])
        return cls(config, Ledger(store), GraphBuilder(list_refs, grasp_files=grasp_files))

    def make(self, targets: Sequence[Stage]) -> Outcomes:
        """Run what is missing, shown on standard error; ends the program on Ctrl-C."""
        from dmfc.engine.watch import Progress

        return run_shown(targets, self.ledger, self.config, Progress(self.ledger, stderr()))


def run_shown(
    targets: Sequence[Stage], ledger: Ledger, config: Config, watcher: Watcher
) -> Outcomes:
    """Run stages, watched. Ctrl-C prints the line that resumes, and ends the program."""
    from dmfc.engine.engine import run_stages, unfinished

    alone = len(unfinished(targets, ledger)) == 1
    # Ray prints the deaths of its processes on standard output, which belongs to the answer.
    with contextlib.redirect_stdout(sys.stderr), interrupts_told():
        outcomes = run_stages(targets, ledger, config, watcher=watcher, local=alone)
        if any(outcome.status == "interrupted" for outcome in outcomes.values()):
            raise KeyboardInterrupt
    return outcomes


@contextlib.contextmanager
def interrupts_told() -> Iterator[None]:
    """On Ctrl-C prints the line that resumes, and ends the program."""
    try:
        yield
    except KeyboardInterrupt:
        line = shlex.join(["dmfc", *sys.argv[1:]])
        stderr().print(
            f"stopped; finished stages are kept. Go on with:\n  {line}",
            soft_wrap=True,
            markup=False,
        )
        raise typer.Exit(INTERRUPTED) from None


def require(outcomes: Mapping[str, Any], stages: Sequence[Stage]) -> None:
    """Raise DmfcError with the first reason if one of the stages is not there."""
    for stage in stages:
        outcome = outcomes[stage.address]
        if not outcome.ok:
            raise DmfcError(f"{stage.kind} {stage.name}: {outcome.reason}")


def failures(outcomes: Outcomes, stages: Sequence[Stage]) -> dict[str, str]:
    """Why those of the stages that are not there failed, by their names."""
    found = {stage.name: outcomes[stage.address] for stage in stages}
    return {name: outcome.reason for name, outcome in found.items() if not outcome.ok}


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


def stderr() -> Console:
    """The console for people; standard output is for answers."""
    from rich.console import Console

    return Console(stderr=True, highlight=False)


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
