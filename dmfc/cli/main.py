"""The command `dmfc`: parsing and printing; each verb imports what it uses when it is called."""

from __future__ import annotations

import sys
from typing import Annotated, Any

import typer

from dmfc.cli import (
    assets,
    benchmark,
    config,
    doctor,
    evaluate,
    exchange,
    grasps,
    objects,
    outcome,
    predict,
    scenes,
    store,
    sweep,
    tables,
    tracking,
    train,
    view,
)
from dmfc.errors import DmfcError, masked, missing_package
from dmfc.experiment.console import stderr
from dmfc.experiment.signals import end_as_by_ctrl_c, interrupted_status

USAGE_ERROR: type[Exception] = typer.BadParameter.__mro__[1]  # type: ignore[assignment]
"""What a wrong command line raises, of which Typer exports this one child alone."""

app = typer.Typer(
    name="dmfc",
    help="Train, ablate and evaluate dense multi-fingered grasp networks.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
app.command()(doctor.doctor)
app.command()(config.config)
app.add_typer(assets.assets, name="assets")
app.add_typer(objects.objects, name="objects")
grasps.grasps.command("import")(exchange.grasps_import)
grasps.grasps.command("export")(exchange.grasps_export)
app.add_typer(grasps.grasps, name="grasps")
app.add_typer(scenes.scenes, name="scenes")
app.command()(train.train)
app.command()(evaluate.evaluate)
app.command()(evaluate.compare)
app.add_typer(benchmark.benchmark, name="benchmark")
app.command()(predict.predict)
app.command()(view.view)
app.add_typer(predict.models_app, name="models")
app.add_typer(outcome.outcome_app, name="outcome")
app.add_typer(sweep.sweep_app, name="sweep")
app.command()(tables.tables)
app.command()(tables.agree)
app.command()(tracking.ui)
app.add_typer(tracking.tracking_app, name="tracking")
app.add_typer(store.store_app, name="store")


def _version(wanted: bool) -> None:
    if wanted:
        from importlib.metadata import version

        typer.echo(f"dmfc {version('dmfc')}")
        raise typer.Exit


@app.callback()
def options(
    debug: Annotated[
        bool, typer.Option("--debug", help="Show tracebacks; allowed anywhere on the line.")
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
    end_as_by_ctrl_c()
    try:
        status = app(prog_name="dmfc", standalone_mode=False)
    except DmfcError as error:
        if debug:
            raise
        _fail(str(error))
    except USAGE_ERROR as error:
        _wrong_usage(error)
    except Exception as error:
        if debug:
            raise
        missing = missing_package(error) if isinstance(error, ModuleNotFoundError) else None
        if missing:
            _fail(str(missing))
        if isinstance(error.__cause__, KeyboardInterrupt):
            stderr().print("stopped")
            sys.exit(interrupted_status())
        cause = error.__cause__ or error  # Typer makes an EOFError an Abort
        first = (str(cause).strip().splitlines() or [""])[0]
        _fail(f"unexpected {type(cause).__name__}: {first} (add --debug for the traceback)")
    sys.exit(status if isinstance(status, int) else 0)


def _wrong_usage(error: Any) -> None:
    """One line and status 2; the help where nothing was asked."""
    command = error.ctx.command_path if error.ctx else "dmfc"
    if not sys.argv[1:] or type(error).__name__ == "NoArgsIsHelpError":
        error.show()
        sys.exit(error.exit_code)
    _fail(f"{error.format_message()} (see {command} --help)", error.exit_code)


def _fail(text: str, status: int = 1) -> None:
    line = masked(" ".join(text.split()))
    stderr().print(f"error: {line}", style="red", markup=False, soft_wrap=True)
    sys.exit(status)
