"""The command `dmfc`: parsing and printing; each verb imports what it uses when it is called."""

from __future__ import annotations

import sys
from typing import Annotated

import typer

from dmfc import (
    cli_data,
    cli_doctor,
    cli_evaluate,
    cli_exchange,
    cli_grasp_stats,
    cli_model,
    cli_predict,
    cli_scenes,
    cli_store,
    cli_sweep,
    cli_tracking,
    cli_view,
)
from dmfc.cli.common import stderr
from dmfc.errors import DmfcError

app = typer.Typer(
    name="dmfc",
    help="Train, ablate and evaluate dense multi-fingered grasp networks.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
app.command()(cli_doctor.doctor)
app.add_typer(cli_data.assets, name="assets")
app.add_typer(cli_data.objects, name="objects")
cli_data.grasps.command("stats")(cli_grasp_stats.grasps_stats)
cli_data.grasps.command("import")(cli_exchange.grasps_import)
cli_data.grasps.command("export")(cli_exchange.grasps_export)
app.add_typer(cli_data.grasps, name="grasps")
app.add_typer(cli_scenes.scenes, name="scenes")
app.command()(cli_model.train)
app.command()(cli_evaluate.evaluate)
app.command()(cli_evaluate.compare)
app.command()(cli_predict.predict)
app.command()(cli_view.view)
app.add_typer(cli_predict.models_app, name="models")
app.add_typer(cli_sweep.sweep_app, name="sweep")
app.command()(cli_sweep.tables)
app.command()(cli_tracking.ui)
app.add_typer(cli_tracking.tracking_app, name="tracking")
app.add_typer(cli_store.store_app, name="store")


def _version(wanted: bool) -> None:
    if wanted:
        from importlib.metadata import version

        typer.echo(f"dmfc {version('dmfc')}")
        raise typer.Exit


@app.callback()
def options(
    debug: Annotated[
        bool, typer.Option("--debug", help="Show tracebacks; may stand anywhere on the line.")
    ] = False,
    version: Annotated[
        bool,
        typer.Option(
            "--version", help="Print the version and end.", callback=_version, is_eager=True
        ),
    ] = False,
) -> None:
    """Train, ablate and evaluate dense multi-fingered grasp networks."""


def main() -> None:
    """Run the command; an error is one line on standard error and status 1 (2: wrong usage)."""
    debug = "--debug" in sys.argv
    if debug:
        sys.argv.remove("--debug")
    try:
        app(prog_name="dmfc")
    except DmfcError as error:
        if debug:
            raise
        _fail(str(error))
    except Exception as error:
        if debug:
            raise
        first = (str(error).strip().splitlines() or [""])[0]
        _fail(f"unexpected {type(error).__name__}: {first} (add --debug for the traceback)")


def _fail(text: str) -> None:
    line = " ".join(text.split())
    stderr().print(f"error: {line}", style="red", markup=False, soft_wrap=True)
    sys.exit(1)
