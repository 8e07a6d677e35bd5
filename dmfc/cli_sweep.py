"""The verbs around a whole experiment: sweep, tables, ui."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from dmfc.cli_common import (
    PRESET,
    STORE,
    AsJson,
    Overrides,
    Preset,
    Session,
    Store,
    answer,
    run_shown,
    show_rows,
    stderr,
)
from dmfc.errors import DmfcError

if TYPE_CHECKING:
    from dmfc.report.table import SweepTable
    from dmfc.sweep.ledger import Ledger
    from dmfc.sweep.plan import SweepPlan


def sweep(
    files: Annotated[
        list[str], typer.Argument(help="Sweep files, or names of shipped ones such as table1.")
    ],
    preset: Preset = PRESET,
    overrides: Overrides = None,
    store: Store = STORE,
    as_json: AsJson = False,
    dry_run: Annotated[
        bool,
        typer.Option("--dry-run", help="List cells and stages, and which are done; run nothing."),
    ] = False,
) -> None:
    """Run every cell of one or more sweeps; go on where an earlier call stopped.

    Prints a table per sweep, writes it to STORE/sweeps/ID/, and brings MLflow up to date.
    """
    from dmfc.sweep.plan import plan_sweep
    from dmfc.sweep.sweep_file import load_sweep

    sweeps = [load_sweep(name) for name in files]
    session = Session.open(preset, overrides, store)
    plans = [plan_sweep(item, session.builder, preset, overrides or []) for item in sweeps]
    if dry_run:
        _dry_run(plans, session.ledger, as_json)
        return
    started = time.monotonic()
    session.ledger.prepare()
    for plan in plans:
        plan.write(session.ledger)
    targets = [stage for plan in plans for stage in plan.targets]
    outcomes = run_shown(targets, session.ledger, plans[0].config)
    failures = {address: out.reason for address, out in outcomes.items() if not out.ok}
    ran = sum(outcome.status == "ran" for outcome in outcomes.values())
    results = [_finish(plan, session.ledger, failures, ran, as_json) for plan in plans]
    closing = {"stages_run": ran, "seconds": round(time.monotonic() - started, 2)}
    if as_json:
        answer({**results[0], **closing} if len(results) == 1 else {"sweeps": results, **closing})
    else:
        store_option = "" if store == STORE else f" --store {store}"
        typer.echo(f"Browse the runs: dmfc ui{store_option}")
    if failures:
        raise typer.Exit(1)


def tables(
    sweep_ids: Annotated[
        list[str] | None,
        typer.Argument(
            help="Ids of sweeps, or their names (the latest of each); default: all names."
        ),
    ] = None,
    store: Store = STORE,
    as_json: AsJson = False,
) -> None:
    """Make the tables again from trial rows alone, without running anything."""
    from dmfc.report.collect import list_sweeps, read_sweep
    from dmfc.sweep.ledger import Ledger

    ledger = Ledger(store)
    known = list_sweeps(ledger)
    if not known:
        raise DmfcError(f"no sweeps in the store '{ledger.store}' yet: run `dmfc sweep` first")
    latest = {sweep_id.rpartition("-")[0]: sweep_id for sweep_id in known}
    wanted = [latest.get(name, name) for name in sweep_ids or sorted(latest)]
    results = [_table(ledger, read_sweep(ledger, name), {}, as_json) for name in wanted]
    if as_json:
        from dmfc.report.formats import to_json

        answer([to_json(table) for table in results])


def ui(
    store: Store = STORE,
    port: Annotated[int, typer.Option(help="Port on 127.0.0.1; 0 takes a free one.")] = 5000,
) -> None:
    """Serve the runs in MLflow on localhost until Ctrl-C."""
    import json

    from dmfc.report.collect import list_sweeps
    from dmfc.sweep.ledger import Ledger
    from dmfc.tracking.ui import run_page, serve

    ledger = Ledger(store)
    try:
        with serve(ledger, port) as address:
            typer.echo(f"MLflow: {address}")
            for sweep_id in reversed(list_sweeps(ledger)):
                marker = ledger.store / "sweeps" / sweep_id / "tracked.json"
                if marker.is_file():
                    known = json.loads(marker.read_text())
                    page = run_page(address, known["experiment_id"], known["run_id"])
                    typer.echo(f"{sweep_id}: {page}")
            typer.echo("Ctrl-C ends it")
            while True:
                time.sleep(1)
    except KeyboardInterrupt:
        typer.echo("ended")


def _finish(
    plan: SweepPlan, ledger: Ledger, failures: dict[str, str], ran: int, as_json: bool
) -> dict[str, Any]:
    """Table and tracking of one sweep; its answer for a machine."""
    from dmfc.report.formats import to_json
    from dmfc.tracking.project import project_sweep

    description = plan.describe()
    table = _table(ledger, description, failures, as_json)
    picture = plan.folder(ledger) / "table.png"
    if ran or not picture.is_file():
        from dmfc.report.figure import draw_rates

        draw_rates(table, picture)
    incomplete = any(row.failure for row in table.rows)
    tracked = project_sweep(
        ledger,
        description,
        table,
        "FAILED" if incomplete else "FINISHED",
        plan.config.run.tracking_uri,
    )
    result = to_json(table)
    for cell in description["cells"]:
        stages = [cell["pretrain"], cell["model"], *cell["evaluations"]]
        entry = result["cells"][cell["name"]].setdefault("stages", [])
        entry += [address for address in stages if address and address not in entry]
    return {
        **result,
        "folder": str(plan.folder(ledger)),
        "mlflow": {"uri": tracked.uri, "experiment": tracked.experiment_id, "run": tracked.run_id},
    }


def _table(
    ledger: Ledger, description: dict[str, Any], failures: dict[str, str], as_json: bool
) -> SweepTable:
    """Make, write and (unless a machine asks) print the table of one sweep."""
    from dmfc.report.collect import collect, write_table
    from dmfc.report.table import make_table

    rows = collect(ledger, description, failures)
    table = make_table(
        rows,
        id=description["id"],
        name=description["name"],
        title=description["title"],
        preset=description["preset"] or "defaults",
    )
    paths = write_table(ledger, table, rows)
    if not as_json:
        _print_table(table, paths)
    return table


def _print_table(table: SweepTable, paths: Sequence[Path]) -> None:
    from rich.console import Console

    from dmfc.report.formats import to_rich

    console = Console(highlight=False)
    if not console.is_terminal:  # a log or a pipe has no width to fit
        console.width = 140
    console.print(to_rich(table))
    for row in table.rows:
        if row.failure:
            stderr().print(f"{row.name}: {row.failure}", markup=False, soft_wrap=True)
    written = ", ".join(path.name for path in paths)
    console.print(f"written: {paths[0].parent}/ ({written})", markup=False, soft_wrap=True)


def _dry_run(plans: Sequence[SweepPlan], ledger: Ledger, as_json: bool) -> None:
    """Every stage of every cell, and whether it is in the ledger."""
    from dmfc.sweep.stage import closure

    described: list[dict[str, Any]] = []
    for plan in plans:
        stages = closure(plan.targets)
        done = {stage.address: ledger.finished(stage.address) for stage in stages}
        cells = []
        for item in plan.cells:
            own = [*([item.stages.model] if item.stages.model else []), *item.stages.evaluations]
            cells.append(
                {
                    "cell": item.cell.name,
                    "seed": item.seed,
                    "model": item.stages.model.address if item.stages.model else item.cell.model,
                    "trials": item.trials,
                    "own_stages": len(own),
                    "done": sum(done[stage.address] for stage in own),
                }
            )
        counts, finished = Counter(s.kind for s in stages), Counter[str]()
        for stage in stages:
            finished[stage.kind] += done[stage.address]
        kinds = [{"kind": k, "stages": n, "done": finished[k]} for k, n in counts.items()]
        listed = [
            {"kind": s.kind, "name": s.name, "key": s.key, "done": done[s.address]} for s in stages
        ]
        described.append({"id": plan.id, "cells": cells, "kinds": kinds, "stages": listed})
    if as_json:
        answer(described[0] if len(described) == 1 else {"sweeps": described})
        return
    for shown in described:
        show_rows(f"{shown['id']}: cells", shown["cells"], as_json=False)
        show_rows("stages by kind", shown["kinds"], as_json=False)
        show_rows("stages", shown["stages"], as_json=False)
