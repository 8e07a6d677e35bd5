"""The verbs around MLflow: tracking sync, rebuild, and ui."""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated

import typer

from dmfc.cli.common import STORE, AsJson, Port, Store
from dmfc.errors import DmfcError
from dmfc.experiment.console import show_rows, stderr

if TYPE_CHECKING:
    from dmfc.engine.ledger import Ledger

tracking_app = typer.Typer(
    name="tracking", help="MLflow as a projection of the store.", no_args_is_help=True
)

Sweeps = Annotated[
    list[str] | None, typer.Argument(help="Ids of sweeps, or their names; default: all sweeps.")
]
Uri = Annotated[
    str, typer.Option("--uri", help="MLflow tracking URI; default: the store's own database.")
]


@tracking_app.command("rebuild")
def rebuild(
    sweeps: Sweeps = None, uri: Uri = "", store: Store = STORE, as_json: AsJson = False
) -> None:
    """Make all runs again in an empty database or on an empty server."""
    from dmfc.engine.ledger import Ledger
    from dmfc.report.collect import list_sweeps, resolve_sweeps
    from dmfc.tracking.project import rebuild as make
    from dmfc.tracking.store import without_user

    ledger = Ledger(store)
    chosen = resolve_sweeps(ledger, sweeps) if sweeps else list_sweeps(ledger)
    made = make(ledger, chosen, uri)
    rows = [
        {"sweep": name, "uri": without_user(at.uri), "run": at.run_id}
        for name, at in zip(chosen, made, strict=True)
    ]
    show_rows("rebuilt", rows, as_json)


@tracking_app.command("sync")
def sync(
    sweeps: Sweeps = None, uri: Uri = "", store: Store = STORE, as_json: AsJson = False
) -> None:
    """Add missing runs to MLflow: after a crash or an outage, or to a second server."""
    from dmfc.engine.ledger import Ledger
    from dmfc.report.collect import list_sweeps, resolve_sweeps
    from dmfc.tracking.project import project_sweep
    from dmfc.tracking.store import without_user

    ledger = Ledger(store)
    chosen = resolve_sweeps(ledger, sweeps) if sweeps else list_sweeps(ledger)
    rows = []
    for sweep_id in chosen:
        tracked = project_sweep(ledger, sweep_id, uri)
        rows.append({"sweep": sweep_id, "uri": without_user(tracked.uri), "run": tracked.run_id})
    show_rows("up to date", rows, as_json)


def ui(
    store: Store = STORE,
    port: Port = 5000,
    open_page: Annotated[
        bool, typer.Option("--open", help="Open the latest sweep in the browser.")
    ] = False,
) -> None:
    """Serve the runs in MLflow on localhost until Ctrl-C; runs on a server are only linked to."""
    from dmfc.engine.ledger import Ledger
    from dmfc.tracking.project import project_stale
    from dmfc.tracking.store import database
    from dmfc.tracking.ui import serve

    ledger = Ledger(store)
    try:
        try:
            project_stale(ledger)
        except DmfcError as error:  # what is there can be looked at
            stderr().print(f"{error}; shown as it is", markup=False, soft_wrap=True)
        there = _tracked(ledger)
        if there and not database(ledger).is_file():  # all of them are on servers
            _show_pages(there, "", open_page)
            return
        with serve(ledger, port) as address:
            typer.echo(f"MLflow: {address}")
            _show_pages(there, address, open_page)
            typer.echo("Ctrl-C ends it")
            while True:
                time.sleep(1)
    except KeyboardInterrupt:
        typer.echo("ended")


def _tracked(ledger: Ledger) -> dict[str, dict[str, str]]:
    """Where each sweep is in MLflow, the latest first."""
    from dmfc.report.collect import list_sweeps
    from dmfc.report.page import read_marker

    names = reversed(list_sweeps(ledger))
    found = {name: read_marker(ledger.store / "sweeps" / name) for name in names}
    return {name: marker for name, marker in found.items() if marker}


def _show_pages(there: Mapping[str, Mapping[str, str]], address: str, open_page: bool) -> None:
    """Print each sweep's page, at its own server or at `address`; open the first."""
    from dmfc.tracking.store import is_server
    from dmfc.tracking.ui import run_page

    pages = []
    for sweep_id, known in there.items():
        at = known["uri"].rstrip("/") if is_server(known["uri"]) else address
        pages.append(run_page(at, known["experiment_id"], known["run_id"]))
        typer.echo(f"{sweep_id}: {pages[-1]}")
    if open_page and pages:
        typer.launch(pages[0])
