"""The commands `dmfc sweep` and `dmfc sweep status`."""

from __future__ import annotations

import dataclasses
import time
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from dmfc.cli import complete
from dmfc.cli.common import PRESET, STORE, AsJson, Overrides, Preset, Store
from dmfc.cli.dry_run import show_plans
from dmfc.errors import DmfcError
from dmfc.experiment.console import answer
from dmfc.experiment.drive import drive, explained_disk_errors, show_status
from dmfc.experiment.session import Session, resumable


class RunByDefault(TyperGroup):
    """`dmfc sweep table1` means `dmfc sweep run table1`."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        first = args[0] if args else "--help"
        if first not in self.commands and first not in ctx.help_option_names:
            args = ["run", *args]
        return super().parse_args(ctx, args)


sweep_app = typer.Typer(name="sweep", cls=RunByDefault, no_args_is_help=True)


@sweep_app.callback()
def group() -> None:
    """Run every cell of one or more sweeps (`run` may be left out), or print their status."""


@sweep_app.command("run")
def sweep(
    files: Annotated[
        list[str],
        typer.Argument(
            help="Sweep files, or names of shipped ones such as table1.",
            autocompletion=complete.sweeps,
        ),
    ],
    preset: Preset = PRESET,
    overrides: Overrides = None,
    store: Store = STORE,
    as_json: AsJson = False,
    seeds: Annotated[
        str,
        typer.Option(
            help="Training seeds such as 0,1,2 in place of those of the sweep file.",
        ),
    ] = "",
    dry_run: Annotated[
        bool,
        typer.Option(
            "--dry-run", help="List cells and stages, which are done, and why others are not."
        ),
    ] = False,
) -> None:
    """Run every cell of one or more sweeps; continue where an earlier call stopped.

    Prints a table per sweep, writes it to STORE/sweeps/ID/, and brings MLflow up to date.
    """
    with resumable():
        _run(files, preset, overrides, store, as_json, dry_run, seeds)


def _run(
    files: list[str],
    preset: list[str],
    overrides: list[str] | None,
    store: Path,
    as_json: bool,
    dry_run: bool,
    seeds: str,
) -> None:
    from dmfc.sweep.planner import plan_sweep
    from dmfc.sweep.sweep_file import load_sweep, with_seeds

    sweeps = [load_sweep(name) for name in files]
    if seeds:
        sweeps = [with_seeds(item, _numbers(seeds)) for item in sweeps]
    session = Session.open(preset, overrides, store)
    plans = [
        plan_sweep(item, session.builder, preset, overrides or [], session.ledger)
        for item in sweeps
    ]
    if dry_run:
        show_plans(plans, session.ledger, as_json)
        return
    started = time.monotonic()
    with explained_disk_errors(session.ledger):
        driven = drive(plans, session.ledger, as_json)
    closing = {"stages_run": driven.ran, "seconds": round(time.monotonic() - started, 2)}
    results = driven.results
    if as_json:
        answer({**results[0], **closing} if len(results) == 1 else {"sweeps": results, **closing})
    else:
        store_option = "" if store == STORE else f" --store {store}"
        typer.echo(f"Browse the runs: dmfc ui{store_option}")
    if not driven.complete:
        raise typer.Exit(1)


def _numbers(text: str) -> list[int]:
    try:
        return [int(item) for item in text.split(",")]
    except ValueError:
        raise DmfcError(f"--seeds wants whole numbers such as 0,1,2, not '{text}'") from None


@sweep_app.command("status")
def status(
    sweep_ids: Annotated[
        list[str] | None, typer.Argument(help="Ids of sweeps, or their names; default: all names.")
    ] = None,
    store: Store = STORE,
    as_json: AsJson = False,
) -> None:
    """Print the status of sweeps: finished, running and failed stages."""
    from dmfc.engine.ledger import Ledger
    from dmfc.engine.state import read_state
    from dmfc.engine.status import counts, running
    from dmfc.report.collect import read_sweep, resolve_sweeps

    ledger = Ledger(store)
    states = []
    for sweep_id in resolve_sweeps(ledger, sweep_ids):
        described = read_sweep(ledger, sweep_id)
        state = read_state(ledger.store / "sweeps" / sweep_id)
        states.append(
            {
                "sweep": sweep_id,
                "status": state.status,
                "drivers": list(state.drivers),
                "stages": counts(ledger, described.stages),
                "running": [dataclasses.asdict(item) for item in running(ledger, described.stages)],
                "failures": dict(state.failures),
            }
        )
    if as_json:
        answer(states)
        return
    for one in states:
        show_status(one)
