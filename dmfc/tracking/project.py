"""MLflow as a projection of the ledger: everything in it is made from files and can be made again.

One parent run per sweep and one child per cell and seed, identified by tags. Projecting twice
changes nothing; projecting while a sweep runs shows how it stands.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from filelock import FileLock, Timeout

from dmfc.engine.ledger import Ledger
from dmfc.engine.provenance import PROVENANCE, VECTOR_FLAGS, read_provenance
from dmfc.engine.state import SweepState, read_state
from dmfc.errors import DmfcError, first_line
from dmfc.files.digest import json_digest
from dmfc.files.sealed import write_sealed
from dmfc.report.collect import list_sweeps, read_sweep, table_of
from dmfc.report.page import MARKER, read_marker
from dmfc.report.table import NAMES, SweepTable
from dmfc.sweep.record import SWEEP, SweepRecord
from dmfc.tracking.cell import ENDED, CellContent, Point, cell_content
from dmfc.tracking.registry import register_best
from dmfc.tracking.store import is_server, sqlite_path, tracking_uri, without_user
from dmfc.tracking.writer import PARENT, Writer

if TYPE_CHECKING:
    from collections.abc import Callable

VERSION = 3
"""Markers of older ones name the store's own database by where the store then was."""
LOCK_SECONDS = 120.0
"""Time that a writer waits for another one of the same sweep."""


@dataclass(frozen=True)
class Tracked:
    """Where a sweep is in MLflow."""

    uri: str
    experiment_id: str
    run_id: str


def project_sweep(
    ledger: Ledger,
    sweep_id: str,
    uri: str = "",
    make_writer: Callable[[str], Writer] = Writer,
) -> Tracked:
    """Bring MLflow up to what the ledger holds of a sweep.

    Without a change since the last call MLflow is not even imported. Raises DmfcError where
    another process writes the same sweep and does not end.
    """
    kept, uri = without_user(uri), uri or tracking_uri(ledger)
    sweep, folder = read_sweep(ledger, sweep_id), ledger.store / "sweeps" / sweep_id
    state = read_state(folder)
    contents = [cell_content(ledger, cell, state) for cell in sweep.cells]
    parent = _parent_content(ledger, sweep, state, contents)
    digest = json_digest([VERSION, kept, parent.digest, [content.digest for content in contents]])
    known = read_marker(folder)
    if known.get("digest") == digest and _still_there(uri):
        return Tracked(uri, known["experiment_id"], known["run_id"])
    ledger.prepare()
    lock = FileLock(ledger.store / "locks" / f"tracking-{sweep_id}.lock", timeout=LOCK_SECONDS)
    try:
        with lock:
            writer = make_writer(uri)
            run_id = writer.parent(sweep, parent)
            runs = {content.id: writer.child(sweep_id, run_id, content) for content in contents}
            if state.status == "FINISHED":
                table = table_of(ledger, sweep, state.failures)
                register_best(writer.client, ledger, sweep, table, runs)
    except Timeout:
        raise DmfcError(f"another process has been writing sweep {sweep_id} to MLflow") from None
    except Exception as error:
        if not type(error).__module__.startswith("mlflow"):
            raise
        line = first_line(error)
        raise DmfcError(
            f"MLflow at '{uri}' was not written: {line} (run.tracking_uri; `dmfc tracking sync` "
            "writes what is missing)"
        ) from error
    marker = {"digest": digest, "uri": kept, "status": parent.status}
    ids = {"experiment_id": writer.experiment_id, "run_id": run_id, "runs": runs}
    write_sealed(folder / MARKER, VERSION, {**marker, **ids})
    return Tracked(uri, writer.experiment_id, run_id)


def project_stale(ledger: Ledger) -> list[str]:
    """Bring sweeps whose drivers died up to date; their ids."""
    stale = []
    for sweep_id in list_sweeps(ledger):
        folder = ledger.store / "sweeps" / sweep_id
        marker, state = read_marker(folder), read_state(folder)
        if marker and marker.get("status") not in ENDED and state.status in ENDED:
            project_sweep(ledger, sweep_id, _uri_of(marker))
            stale.append(sweep_id)
    return stale


def rebuild(ledger: Ledger, sweep_ids: Sequence[str], uri: str = "") -> list[Tracked]:
    """Make the runs of those sweeps in an empty experiment.

    Raises DmfcError if the experiment has runs: nothing is ever removed.
    """
    uri = uri or tracking_uri(ledger)
    if Writer(uri).has_runs():
        raise DmfcError(
            f"'{uri}' has runs already: name an empty place by --uri, or remove that one first"
        )
    return [project_sweep(ledger, sweep_id, uri) for sweep_id in sweep_ids]


def _parent_content(
    ledger: Ledger,
    sweep: SweepRecord,
    state: SweepState,
    contents: list[CellContent],
) -> CellContent:
    """The parent run: the table's rates, its files, and what made it."""
    folder = ledger.store / "sweeps" / sweep.id
    calls = read_provenance(folder)
    start = int(1000 * state.started)
    end = max([start, *(content.end_ms for content in contents)])
    metrics: list[Point] = []
    files: list[tuple[Path, str | None]] = []
    tags = {f"dmfc.{name}": call for name, call in _provenance_tags(calls).items()}
    if calls:
        tags["mlflow.source.git.commit"] = calls[-1]["commit"]
    if state.status in ENDED:
        table = table_of(ledger, sweep, state.failures)
        metrics = [(name, value, end, 0) for name, value in _parent_rates(table)]
        metrics += [
            ("search.objective", trial.value, end, step)
            for step, trial in enumerate(table.trials)
            if trial.value is not None
        ]
        files = [(path, None) for path in sorted(folder.iterdir()) if _shown(path)]
    else:
        done = sum(content.status in ENDED for content in contents)
        tags["dmfc.progress"] = f"{done} of {len(contents)} cells"
    return CellContent(
        id=PARENT,
        status="SCHEDULED" if state.status == "UNSTARTED" else state.status,
        params={"preset": sweep.preset or "defaults", "file": sweep.file},
        metrics=metrics,
        tags=tags,
        texts={SWEEP: json.dumps(sweep.to_json(), indent=1)},
        files=files,
        data=[],
        start_ms=start,
        end_ms=end,
    )


def _parent_rates(table: SweepTable) -> list[tuple[str, float]]:
    """Rates of the rows that are complete, as 'row.rate'.

    MLflow takes no '+' in a metric's name: 'guidance+q1_upper' is 'guidance q1_upper' here.
    """
    return [
        (f"{row.name.replace('+', ' ')}.{name}", value)
        for row in table.rows
        for name in NAMES
        if not row.failure and (value := row.rate(name).value) is not None
    ]


def _provenance_tags(calls: list[dict[str, Any]]) -> dict[str, str]:
    """The latest call for a person who looks; all of it is in provenance.json."""
    if not calls:
        return {}
    latest, packages = calls[-1], calls[-1]["packages"]
    versions = {name: packages.get(name, "") for name in ("dmfc", "torch", "mujoco", "ray")}
    return {
        "commits": " ".join(dict.fromkeys(call["commit"] for call in calls)),
        "host": latest["host"],
        "processor": latest["processor"],
        "vector_flags": " ".join(
            flag for flag in latest["flags"].split() if flag.startswith(VECTOR_FLAGS)
        ),
        "versions": " ".join(f"{name} {version}" for name, version in versions.items()),
    }


def _shown(path: Path) -> bool:
    """Files of a sweep's folder that the parent run shows: tables, figures, what made them."""
    return path.stem in ("table", "trials", "curves", "search") or (
        path.name == PROVENANCE or path.suffix == ".diff"
    )


def _uri_of(marker: dict[str, Any]) -> str:
    """Where the runs of a sweep are; empty: in the store's own database."""
    uri = str(marker["uri"])
    return uri if marker.get("version", 0) >= 3 or is_server(uri) else ""


def _still_there(uri: str) -> bool:
    """Whether a local database is still there; a remote one is taken to be."""
    path = sqlite_path(uri)
    return path is None or path.is_file()
