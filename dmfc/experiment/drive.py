"""One call of `dmfc sweep` from the first stage to the last line printed."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from dmfc.errors import DmfcError
from dmfc.experiment.console import show_rows, stderr
from dmfc.experiment.session import run_shown

if TYPE_CHECKING:
    from dmfc.engine.engine import Outcomes
    from dmfc.engine.ledger import Ledger
    from dmfc.report.rates import Over
    from dmfc.report.table import SweepTable
    from dmfc.sweep.plan import SweepPlan
    from dmfc.sweep.record import SearchRecord, SweepRecord
    from dmfc.tracking.live import LiveTracking


@dataclass(frozen=True)
class Driven:
    """Stages that were run, whether all is complete (MLflow too), and answers for machines."""

    ran: int
    complete: bool
    results: list[dict[str, Any]]


def drive(plans: Sequence[SweepPlan], ledger: Ledger, as_json: bool) -> Driven:
    """Run what is missing of the sweeps, write their tables and bring MLflow up to date.

    Ends the program on Ctrl-C and SIGTERM, after saying so in the sweeps' state and, where that
    takes a moment only, in MLflow.
    """
    from dmfc.engine.state import driving, write_state
    from dmfc.tracking.live import END_SECONDS, INTERRUPTED_SECONDS, LiveTracking
    from dmfc.tracking.store import require_answer

    ledger.prepare()
    folders = [plan.write(ledger) for plan in plans]
    run = plans[0].config.run
    try:
        require_answer(run.tracking_uri)
    except DmfcError as error:  # MLflow can be made later; the sweep need not wait for it
        stderr().print(f"{error}; the sweep goes on", markup=False, soft_wrap=True)
    live = LiveTracking(ledger, [plan.id for plan in plans], run.tracking_uri, run.tracking_seconds)
    patience = INTERRUPTED_SECONDS
    try:
        with driving(folders):
            outcomes: Outcomes = {}
            growing: Sequence[SweepPlan] = plans
            while growing:
                outcomes |= _run(plans, growing, ledger, live, outcomes)
                failures = _failures(outcomes)
                grown = [plan.grow(failures) for plan in plans]
                growing = [plan for plan in grown if plan]
                plans = [new or plan for new, plan in zip(grown, plans, strict=True)]
                for plan in growing:
                    plan.write(ledger)
            ran = sum(outcome.status == "ran" for outcome in outcomes.values())
            tables = []
            for plan, folder in zip(plans, folders, strict=True):
                try:
                    table = write_tables(ledger, plan.record(), failures, as_json)
                except DmfcError:  # its rows are damaged
                    write_state(folder, "FAILED", failures)
                    raise
                tables.append(table)
                write_state(folder, "FAILED" if _incomplete(table) else "FINISHED", failures)
            patience = END_SECONDS
    except (typer.Exit, KeyboardInterrupt):
        for folder in folders:
            write_state(folder, "KILLED", {})
        raise
    finally:
        live.finish(patience)
    results = [_result(*item, ledger, ran > 0) for item in zip(plans, tables, strict=True)]
    tracked = all("error" not in result["mlflow"] for result in results)
    return Driven(ran, tracked and not any(_incomplete(table) for table in tables), results)


@contextmanager
def explained_disk_errors(ledger: Ledger) -> Iterator[None]:
    """Turns an error of the driver's own files into a line; those of stages are outcomes."""
    try:
        yield
    except OSError as error:
        raise DmfcError(
            f"the store '{ledger.store}' cannot be used: {error.strerror or error}; finished "
            "stages are kept: once the store can be written, run the same line again"
        ) from error


def _failures(outcomes: Outcomes) -> dict[str, str]:
    return {address: outcome.reason for address, outcome in outcomes.items() if not outcome.ok}


def _run(
    plans: Sequence[SweepPlan],
    growing: Sequence[SweepPlan],
    ledger: Ledger,
    live: LiveTracking,
    before: Outcomes,
) -> Outcomes:
    """Run what is missing of the plans that are `growing`; `before` is of earlier rounds."""
    from dmfc.engine.engine import unfinished
    from dmfc.engine.provenance import add_provenance
    from dmfc.engine.state import write_state
    from dmfc.pipeline.kinds import KINDS
    from dmfc.report.board import Board

    folders, failed = [plan.folder(ledger) for plan in growing], _failures(before)

    class Watcher(Board):
        """Shows, keeps failures where others can read them, and starts the live tracking."""

        failures = dict(failed)  # noqa: RUF012  # one watcher is made

        def finished(self, stage: Any, outcome: Any) -> None:
            super().finished(stage, outcome)
            if not outcome.ok:
                self.failures[stage.address] = outcome.reason
                for folder in folders:
                    write_state(folder, "RUNNING", self.failures)

        def tick(self, running: Any) -> None:
            super().tick(running)
            live.tick()

    targets = [stage for plan in growing for stage in plan.targets]
    for plan, folder in zip(growing, folders, strict=True):
        write_state(folder, "RUNNING", failed)
        if not before and unfinished(plan.targets, ledger):
            add_provenance(folder)
        if plan.search:
            stderr().print(f"{plan.sweep.name}: {_round(plan.search)}", soft_wrap=True)
    watcher = Watcher(ledger, stderr(), [plan.record() for plan in plans], KINDS)
    return run_shown(targets, ledger, plans[0].config, watcher)


def _round(search: SearchRecord) -> str:
    """What a search does next."""
    if search.best is not None:
        return f"trial {search.best} is the best; it is executed"
    return f"{len(search.trials)} of {search.wanted} trials"


def write_tables(
    ledger: Ledger,
    description: SweepRecord,
    failures: Mapping[str, str],
    as_json: bool,
    read_only: bool = False,
    over: Over = "scenes",
) -> SweepTable:
    """Make, write and (unless a machine asks) print the table of one sweep.

    `read_only`: where the store cannot be written, say so and go on. `over`: what the intervals
    hold for that are printed.
    """
    from dmfc.report.collect import collect, table_from, write_table
    from dmfc.report.left_out import left_out
    from dmfc.report.trials import read_trials

    rows = collect(ledger, description, failures)
    table = table_from(rows, description, read_trials(ledger, description, failures))
    table = replace(table, left_out=left_out(ledger, description.stages))
    paths: list[Path] = []
    try:
        paths = write_table(ledger, table, rows)
    except OSError as error:
        if not read_only:
            raise
        stderr().print(f"not written: {error}", markup=False, soft_wrap=True)
    if not as_json:
        print_table(table, paths, over)
    return table


def page_writer(ledger: Ledger, description: SweepRecord, table: SweepTable) -> Callable[[], Path]:
    """Draw the figures of a sweep's page; gives what writes the page as things then stand."""
    from dmfc.report.page import draw_figures, write_page

    figures = draw_figures(ledger, description, table)
    return lambda: write_page(ledger, description, table, figures)


def show_status(status: Mapping[str, Any]) -> None:
    """Print how one sweep stands."""
    at = f" by {', '.join(status['drivers'])}" if status["drivers"] else ""
    typer.echo(f"{status['sweep']}: {status['status']}{at}")
    stages = [{"kind": k, "done": d, "stages": n} for k, (d, n) in status["stages"].items()]
    show_rows("stages", stages, as_json=False)
    now = [
        {
            "stage": f"{item['address'].partition('/')[0]} {item['name']}",
            "host": item["host"],
            "seconds": round(item["seconds"]),
            "progress": f"{item['fraction']:.0%} {item['message']}".strip(),
        }
        for item in status["running"]
    ]
    if now:
        show_rows("running", now, as_json=False)
    failed = [{"stage": name, "reason": reason} for name, reason in status["failures"].items()]
    if failed:
        show_rows("failed", failed, as_json=False)


def _incomplete(table: SweepTable) -> bool:
    return any(row.failure for row in table.rows)


def _result(plan: SweepPlan, table: SweepTable, ledger: Ledger, changed: bool) -> dict[str, Any]:
    """Page and tracking of one sweep, and its answer for a machine."""
    from dmfc.report.formats import to_json
    from dmfc.report.outputs import intact
    from dmfc.report.page import PAGE

    if changed or not intact(plan.folder(ledger), PAGE):
        write = page_writer(ledger, plan.record(), table)
        write()  # for MLflow to show
        tracked = _track(plan, ledger)
        write()  # with links to the runs that there are now
    else:
        tracked = _track(plan, ledger)
    result = to_json(table)
    for cell in plan.record().cells:
        shown = result["cells"].get(cell.name) or result["search"][cell.name]
        entry = shown.setdefault("stages", [])
        entry += [address for address in cell.stages if address not in entry]
    return {
        **result,
        "folder": str(plan.folder(ledger)),
        "mlflow": tracked,
    }


def _track(plan: SweepPlan, ledger: Ledger) -> dict[str, str]:
    """Bring MLflow up to date; where the sweep is in it, or why it is not."""
    from dmfc.tracking.project import project_sweep
    from dmfc.tracking.store import without_user

    try:
        tracked = project_sweep(ledger, plan.id, plan.config.run.tracking_uri)
    except DmfcError as error:  # the table stands, and other sweeps have their own result
        stderr().print(f"{plan.id}: {error}", markup=False, soft_wrap=True)
        return {"error": str(error)}
    return {
        "uri": without_user(tracked.uri),
        "experiment": tracked.experiment_id,
        "run": tracked.run_id,
    }


def print_table(table: SweepTable, paths: Sequence[Path], over: Over = "scenes") -> None:
    """Print a table, what it is made without, and the files that have it."""
    from rich.console import Console

    from dmfc.report.formats import to_rich
    from dmfc.report.left_out import SHOWN, left_out_line
    from dmfc.report.trials import trials_to_rich

    console = Console(highlight=False)
    if not console.is_terminal:  # a log or a pipe has no width to fit
        console.width = 140
    console.print(to_rich(table, over))
    console.print(left_out_line(table.left_out, SHOWN), markup=False, soft_wrap=True)
    if table.trials:
        console.print(trials_to_rich(table.trials))
    for row in table.rows:
        if row.failure:
            stderr().print(f"{row.name}: {row.failure}", markup=False, soft_wrap=True)
    if paths:
        written = ", ".join(path.name for path in paths)
        console.print(f"written: {paths[0].parent}/ ({written})", markup=False, soft_wrap=True)
