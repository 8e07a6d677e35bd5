"""Trial rows of a sweep, gathered from the ledger by its `sweep.json`; tables written beside it."""

from __future__ import annotations

import shlex
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from dmfc.engine.ledger import Ledger
from dmfc.engine.provenance import read_provenance
from dmfc.errors import DmfcError, unknown_name
from dmfc.files.atomic import write_json, write_text, written_whole
from dmfc.files.sealed import DamagedError
from dmfc.pipeline.artifacts import TRIALS, load_trials
from dmfc.report.formats import to_json
from dmfc.report.left_out import left_out
from dmfc.report.markdown import texts
from dmfc.report.outputs import note_outputs
from dmfc.report.rates import concatenate
from dmfc.report.table import CellRows, SweepTable, make_table
from dmfc.report.trials import SearchTrial, read_trials, trials_to_csv
from dmfc.sweep.record import SWEEP, CellRecord, SweepRecord


def list_sweeps(ledger: Ledger) -> list[str]:
    """Ids of the sweeps in a store, the latest last."""
    found = (ledger.store / "sweeps").glob(f"*/{SWEEP}")
    return [path.parent.name for path in sorted(found, key=lambda path: path.stat().st_mtime)]


def resolve_sweeps(ledger: Ledger, names: Sequence[str] | None = None) -> list[str]:
    """Ids of the sweeps called so: a name is the latest of that name; None: each name's latest.

    Raises DmfcError if the store has no sweeps, or none of that name.
    """
    known = list_sweeps(ledger)
    if not known:
        raise DmfcError(f"no sweeps in the store '{ledger.store}' yet: run `dmfc sweep` first")
    latest = {sweep_id.rpartition("-")[0]: sweep_id for sweep_id in known}
    for name in names or ():
        if name not in latest and name not in known:
            raise unknown_name("sweep", name, [*latest, *known])
    return [latest.get(name, name) for name in names or sorted(latest)]


def read_sweep(ledger: Ledger, sweep_id: str) -> SweepRecord:
    """The record of a sweep. Raises DmfcError naming the nearest id, or for one that is damaged."""
    folder = ledger.store / "sweeps" / sweep_id
    if not (folder / SWEEP).is_file():
        raise unknown_name("sweep", sweep_id, list_sweeps(ledger))
    return SweepRecord.load(folder)


def sweeps_using(ledger: Ledger, addresses: Collection[str]) -> list[str]:
    """The lines of the latest calls of the sweeps that need one of those stages.

    Of a sweep whose record is damaged too: its line writes it again.
    """
    lines = []
    for sweep_id in list_sweeps(ledger):
        try:
            needed = set(addresses) & read_sweep(ledger, sweep_id).stages.keys()
        except DamagedError:
            needed = set(addresses)
        calls = read_provenance(ledger.store / "sweeps" / sweep_id) if needed else []
        lines += [shlex.join(["dmfc", *call["command"]]) for call in calls[-1:]]
    return list(dict.fromkeys(lines))


def collect(
    ledger: Ledger, sweep: SweepRecord, failures: Mapping[str, str] | None = None
) -> list[CellRows]:
    """The rows of every cell that is executed. `failures` gives reasons by address of a stage."""
    cells = [cell for cell in sweep.cells if cell.evaluations]
    return [cell_rows(ledger, cell, failures or {}) for cell in cells]


def table_of(
    ledger: Ledger, sweep: SweepRecord, failures: Mapping[str, str] | None = None
) -> SweepTable:
    """The table of a sweep from what is in the ledger."""
    trials = read_trials(ledger, sweep, failures or {})
    table = table_from(collect(ledger, sweep, failures), sweep, trials)
    return replace(table, left_out=left_out(ledger, sweep.stages))


def table_from(
    cells: Sequence[CellRows], sweep: SweepRecord, trials: Sequence[SearchTrial] = ()
) -> SweepTable:
    """The table of a sweep from the rows of its cells, and from the trials of a search."""
    return make_table(
        cells,
        id=sweep.id,
        name=sweep.name,
        title=sweep.title,
        preset=sweep.preset or "defaults",
        show=sweep.show,
        baseline=sweep.baseline,
        trials=trials,
    )


def write_table(ledger: Ledger, table: SweepTable, rows: list[CellRows]) -> list[Path]:
    """Write table.md, .csv, .tex, .json and all trial rows into the sweep's folder."""
    folder = ledger.store / "sweeps" / table.id
    folder.mkdir(parents=True, exist_ok=True)
    names = {f"table.{suffix}": text for suffix, text in texts(table).items()}
    if table.trials:
        names["search.csv"] = trials_to_csv(table.trials)
    paths = []
    for name, text in names.items():
        path = folder / name
        write_text(path, text)
        paths.append(path)
    write_json(folder / "table.json", to_json(table))
    parts = [cell.rows.assign(cell=cell.name, seed=cell.seed) for cell in rows if len(cell.rows)]
    with written_whole(folder / TRIALS) as temporary:
        concatenate(parts).to_parquet(temporary, index=False)
    paths += [folder / "table.json", folder / TRIALS]
    note_outputs(folder, [path.name for path in paths])
    return paths


def cell_rows(ledger: Ledger, cell: CellRecord, failures: Mapping[str, str]) -> CellRows:
    """The trial rows of one cell at one seed, and why some are missing."""
    parts, missing = [], []
    for address in cell.evaluations:
        if ledger.finished(address):
            parts.append(load_trials(ledger.verified(address)))
        else:
            missing.append(failures.get(address, "not run yet"))
    failure = ""
    if missing:
        told = "; ".join(dict.fromkeys(missing))
        failure = f"{len(missing)} of {len(cell.evaluations)} shards missing: {told}"
    return CellRows(
        name=cell.name,
        label=cell.label,
        seed=cell.seed,
        trials=cell.trials,
        rows=concatenate(parts),
        paper=cell.paper,
        failure=failure,
    )
