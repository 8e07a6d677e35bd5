"""The verbs that read tables of finished sweeps: tables, agree."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from dmfc.cli.common import STORE, AsJson, OverOption, Store
from dmfc.cli.outputs import folder_to_write
from dmfc.experiment.console import answer

if TYPE_CHECKING:
    from dmfc.engine.ledger import Ledger
    from dmfc.report.table import SweepTable


def tables(
    names: Annotated[
        list[str] | None,
        typer.Argument(
            help="Ids of sweeps, or their names (the latest of each); default: all names. Or "
            "exported rows, NAME.trials.parquet: the files beside them are written again."
        ),
    ] = None,
    store: Store = STORE,
    as_json: AsJson = False,
    over: OverOption = "scenes",
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            "-o",
            help="Folder that tables of the store are exported to, as NAME.md, .csv, .tex, .json, "
            ".png, .html and .trials.parquet.",
            callback=folder_to_write(),
        ),
    ] = None,
) -> None:
    """Make the tables again from trial rows alone, without running anything."""
    from dmfc.engine.ledger import Ledger
    from dmfc.report.collect import resolve_sweeps
    from dmfc.report.formats import to_json

    files = [Path(name) for name in names or () if name.endswith(".parquet")]
    sweeps = [name for name in names or () if not name.endswith(".parquet")]
    results = [_exported(path, as_json, over) for path in files]
    if sweeps or not files:
        ledger = Ledger(store)
        wanted = resolve_sweeps(ledger, sweeps or None)
        results += [_stored(ledger, name, as_json, over, out) for name in wanted]
    if as_json:
        answer([to_json(table) for table in results])


def agree(
    reference: Annotated[
        Path, typer.Argument(help="Folder of exported tables, such as results/quick.")
    ],
    names: Annotated[
        list[str] | None,
        typer.Argument(help="Names of sweeps; default: those that the folder and the store have."),
    ] = None,
    store: Store = STORE,
    as_json: AsJson = False,
) -> None:
    """Say of each row of a table whether it agrees with that of a reference."""
    from dmfc.engine.ledger import Ledger
    from dmfc.report.agreement import agreements

    found = agreements(Ledger(store), reference, names or [])
    if as_json:
        answer([one.row() for one in found])
        return
    typer.echo(
        f"Each row beside {reference}. The intervals of the {len(found)} differences hold "
        "together with 95 %."
    )
    for one in found:
        typer.echo(one.line)


def _exported(path: Path, as_json: bool, over: Any) -> SweepTable:
    from dmfc.experiment.drive import print_table
    from dmfc.report.exported import read_table, write_formats

    table = read_table(path)
    paths = write_formats(path, table)
    if not as_json:
        print_table(table, paths, over)
    return table


def _stored(ledger: Ledger, name: str, as_json: bool, over: Any, out: Path | None) -> SweepTable:
    from dmfc.engine.state import read_state
    from dmfc.experiment.drive import page_writer, write_tables
    from dmfc.report.collect import read_sweep
    from dmfc.report.exported import export_table

    failures = read_state(ledger.store / "sweeps" / name).failures
    described = read_sweep(ledger, name)
    table = write_tables(ledger, described, failures, as_json, read_only=True, over=over)
    try:
        page = page_writer(ledger, described, table)()
    except OSError:  # the table has said so
        return table
    if out is not None:
        export_table(ledger, described, table, out)
    if not as_json:
        typer.echo(f"page: {page}")
    return table
