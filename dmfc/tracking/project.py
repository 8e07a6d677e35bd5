"""MLflow as a projection of the ledger: everything in it is made from files and can be made again.

One parent run per sweep and one child per cell and seed, told apart by tags, so that projecting
twice changes nothing. Only the driver writes, under a lock.
"""

from __future__ import annotations

import hashlib
import json
import logging
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from filelock import FileLock

from dmfc.report.table import SweepTable
from dmfc.sweep.context import write_json
from dmfc.sweep.ledger import Ledger
from dmfc.tracking.cell import CellContent, cell_content
from dmfc.tracking.store import EXPERIMENT, artifact_root, tracking_uri

if TYPE_CHECKING:
    from mlflow.tracking import MlflowClient

VERSION = 1
TAG_SWEEP, TAG_CELL, TAG_DIGEST = "dmfc.sweep", "dmfc.cell", "dmfc.digest"
TAG_PARENT = "mlflow.parentRunId"
BATCH = 900
"""Metrics per request; the server takes 1,000."""


@dataclass(frozen=True)
class Tracked:
    """Where a sweep is in MLflow."""

    uri: str
    experiment_id: str
    run_id: str


def project_sweep(
    ledger: Ledger, sweep: Mapping[str, Any], table: SweepTable, status: str, uri: str = ""
) -> Tracked:
    """Bring MLflow up to what the ledger holds of a sweep.

    `status` is the parent's: FINISHED, FAILED or KILLED. Without a change since the last call
    MLflow is not even imported.
    """
    uri = uri or tracking_uri(ledger)
    folder = ledger.store / "sweeps" / sweep["id"]
    contents = [cell_content(ledger, cell, table) for cell in sweep["cells"]]
    digest = _digest([VERSION, uri, status, [content.digest for content in contents]])
    marker = folder / "tracked.json"
    known = json.loads(marker.read_text()) if marker.is_file() else {}
    if known.get("digest") == digest and _still_there(uri):
        return Tracked(uri, known["experiment_id"], known["run_id"])
    ledger.prepare()
    with FileLock(ledger.store / "locks" / "tracking.lock"):
        tracked = _Writer(ledger, uri).write(sweep, table, contents, status)
    write_json(
        marker,
        {"digest": digest, "experiment_id": tracked.experiment_id, "run_id": tracked.run_id},
    )
    return tracked


class _Writer:
    """The one writer; talks to MLflow by its client alone, so no global state is touched."""

    def __init__(self, ledger: Ledger, uri: str) -> None:
        from mlflow.tracking import MlflowClient

        # After the import, which sets its own level: making tables is no news to the user.
        for name in ("mlflow", "alembic"):
            logging.getLogger(name).setLevel(logging.WARNING)

        if uri == tracking_uri(ledger):
            artifact_root(ledger).mkdir(parents=True, exist_ok=True)
        self.client: MlflowClient = MlflowClient(uri)
        self.ledger, self.uri = ledger, uri
        self.experiment_id = self._experiment(ledger)

    def write(
        self,
        sweep: Mapping[str, Any],
        table: SweepTable,
        contents: list[CellContent],
        status: str,
    ) -> Tracked:
        parent = self._parent(sweep, contents)
        for content in contents:
            self._child(sweep["id"], parent, content)
        self._parent_results(parent, sweep, table)
        self.client.set_terminated(parent, status, _latest(contents))
        return Tracked(self.uri, self.experiment_id, parent)

    def _experiment(self, ledger: Ledger) -> str:
        found = self.client.get_experiment_by_name(EXPERIMENT)
        if found:
            return found.experiment_id
        local = self.uri == tracking_uri(ledger)
        location = artifact_root(ledger).as_uri() if local else None
        return self.client.create_experiment(EXPERIMENT, artifact_location=location)

    def _find(self, **tags: str) -> list[Any]:
        wanted = " and ".join(f"tags.`{name}` = '{value}'" for name, value in tags.items())
        return list(self.client.search_runs([self.experiment_id], wanted, max_results=1000))

    def _parent(self, sweep: Mapping[str, Any], contents: list[CellContent]) -> str:
        found = self._find(**{TAG_SWEEP: sweep["id"], TAG_CELL: "-"})
        if found:
            return found[0].info.run_id
        from mlflow.entities import Param

        tags = {TAG_SWEEP: sweep["id"], TAG_CELL: "-", "mlflow.note.content": sweep["title"]}
        start = min((content.start_ms for content in contents if content.start_ms), default=None)
        run = self.client.create_run(self.experiment_id, start, tags, run_name=sweep["id"])
        params = {"preset": sweep["preset"] or "defaults", "file": sweep["file"]}
        self.client.log_batch(run.info.run_id, params=[Param(*item) for item in params.items()])
        return run.info.run_id

    def _child(self, sweep_id: str, parent: str, content: CellContent) -> None:
        """Write the cell's run unless it is there; one that is out of date or half is replaced."""
        found = self._find(**{TAG_SWEEP: sweep_id, TAG_CELL: content.id})
        current = [run for run in found if run.data.tags.get(TAG_DIGEST) == content.digest]
        for run in found:
            if run not in current[:1]:
                self.client.delete_run(run.info.run_id)
        if current:
            return
        from mlflow.entities import Metric, Param

        tags = {TAG_SWEEP: sweep_id, TAG_CELL: content.id, TAG_PARENT: parent, **content.tags}
        run = self.client.create_run(
            self.experiment_id, content.start_ms, tags, run_name=content.id
        )
        run_id = run.info.run_id
        self.client.log_batch(run_id, params=[Param(*item) for item in content.params.items()])
        metrics = [Metric(*point) for point in content.metrics]
        for start in range(0, len(metrics), BATCH):
            self.client.log_batch(run_id, metrics=metrics[start : start + BATCH])
        for name, text in content.texts.items():
            self.client.log_text(run_id, text, name)
        for path, folder in content.files:
            self.client.log_artifact(run_id, str(path), folder)
        self.client.set_terminated(run_id, content.status, content.end_ms)
        # Last: a run without this tag was not written whole, and is replaced.
        self.client.set_tag(run_id, TAG_DIGEST, content.digest)

    def _parent_results(self, parent: str, sweep: Mapping[str, Any], table: SweepTable) -> None:
        from mlflow.entities import Metric

        known = self.client.get_run(parent).data.metrics
        rates = {
            f"{row.name}.{name}": value
            for row in table.rows
            for name in ("valid", "success", "overall")
            if (value := row.rate(name).value) is not None
        }
        new = [
            Metric(name, value, 0, 0) for name, value in rates.items() if known.get(name) != value
        ]
        if new:
            self.client.log_batch(parent, metrics=new)
        self.client.log_dict(parent, dict(sweep), "sweep.json")
        for path in sorted((self.ledger.store / "sweeps" / sweep["id"]).glob("t*.*")):
            if path.stem in ("table", "trials"):
                self.client.log_artifact(parent, str(path))


def _latest(contents: list[CellContent]) -> int | None:
    return max((content.end_ms for content in contents if content.end_ms), default=None)


def _still_there(uri: str) -> bool:
    """Whether a local database is still there; a remote one is taken to be."""
    return not uri.startswith("sqlite:///") or Path(uri.removeprefix("sqlite:///")).is_file()


def _digest(value: Any) -> str:
    return hashlib.sha256(json.dumps(value, sort_keys=True).encode()).hexdigest()
