"""The one writer of a sweep's runs: brings MLflow up to given contents, adding what is missing.

It talks to MLflow by its client alone, so no global state is touched. What it has written it
remembers; what another process wrote it reads back first, so no step is ever written twice.
"""

from __future__ import annotations

import contextlib
import io
import json
import logging
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from dmfc.sweep.record import SweepRecord
from dmfc.tracking.cell import ENDED, CellContent, Point
from dmfc.tracking.moved import EXPERIMENT, set_locations
from dmfc.tracking.store import artifacts_beside, require_answer, sqlite_path

if TYPE_CHECKING:
    from mlflow.tracking import MlflowClient

TAG_SWEEP, TAG_CELL, TAG_DIGEST = "dmfc.sweep", "dmfc.cell", "dmfc.digest"
TAG_PARENT = "mlflow.parentRunId"
PARENT = "-"
"""The 'cell' of a parent run."""
BATCH = 900
"""Metrics per request; the server takes 1,000."""


@dataclass
class _Known:
    """What a run holds, as far as this process knows."""

    run_id: str
    status: str = ""
    params: dict[str, str] = field(default_factory=dict)
    tags: dict[str, str] = field(default_factory=dict)
    values: dict[tuple[str, int], list[float]] = field(default_factory=dict)
    files: set[tuple[Path, str | None]] = field(default_factory=set)

    def contradicts(self, content: CellContent) -> bool:
        """Whether something is written that cannot be changed and should be otherwise."""
        if any(self.params.get(name, value) != value for name, value in content.params.items()):
            return True
        wanted = {(name, step): [value] for name, value, _, step in content.metrics}
        # While a stage is being moved to its place its metrics are nowhere.
        needed = content.status in ENDED
        return any(
            wanted[point] != values if point in wanted else needed
            for point, values in self.values.items()
        )


class Writer:
    """Writes the runs of one tracking server."""

    def __init__(self, uri: str) -> None:
        from mlflow.tracking import MlflowClient

        require_answer(uri)
        # After the import, which sets its own level: making tables is no news to the user.
        for name in ("mlflow", "alembic"):
            logging.getLogger(name).setLevel(logging.WARNING)
        path = sqlite_path(uri)
        if path is not None:
            path.parent.mkdir(parents=True, exist_ok=True)
        self._artifacts = artifacts_beside(path) if path else None
        self.client: MlflowClient = MlflowClient(uri)
        self.uri = uri
        if path is not None:
            set_locations(path, artifacts_beside(path))
        self.experiment_id = self._experiment()
        self._known: dict[tuple[str, str], _Known] = {}

    def has_runs(self) -> bool:
        """Whether the experiment holds any run."""
        return bool(self.client.search_runs([self.experiment_id], max_results=1))

    def parent(self, sweep: SweepRecord, content: CellContent) -> str:
        """Bring the parent run up to date; its id."""
        tags = {"mlflow.note.content": sweep.title}
        return self._bring(sweep.id, sweep.id, content, tags)

    def child(self, sweep_id: str, parent: str, content: CellContent) -> str:
        """Bring a cell's run up to date; its id."""
        return self._bring(sweep_id, content.id, content, {TAG_PARENT: parent})

    def _bring(self, sweep_id: str, name: str, content: CellContent, tags: dict[str, str]) -> str:
        cell = content.id
        known = self._known.get((sweep_id, cell)) or self._read(sweep_id, cell)
        if known and known.contradicts(content):
            self.client.delete_run(known.run_id)
            known = None
        if known is None:
            known = self._create(sweep_id, name, content, tags)
        self._known[sweep_id, cell] = known
        if known.tags.get(TAG_DIGEST) != content.digest:
            self._update(known, content)
        return known.run_id

    def _experiment(self) -> str:
        from mlflow.exceptions import MlflowException

        found = self.client.get_experiment_by_name(EXPERIMENT)
        if found:
            return found.experiment_id
        place = None  # a server decides itself
        if self._artifacts:
            self._artifacts.mkdir(exist_ok=True)
            place = self._artifacts.as_uri()
        try:
            return self.client.create_experiment(EXPERIMENT, place)
        except MlflowException:  # another writer made it meanwhile
            made = self.client.get_experiment_by_name(EXPERIMENT)
            if made is None:
                raise
            return made.experiment_id

    def _read(self, sweep_id: str, cell: str) -> _Known | None:
        """The cell's run in MLflow; of several (none should be) all but one are removed."""
        wanted = f"tags.`{TAG_SWEEP}` = '{sweep_id}' and tags.`{TAG_CELL}` = '{cell}'"
        found = list(self.client.search_runs([self.experiment_id], wanted))
        for run in found[1:]:
            self.client.delete_run(run.info.run_id)
        if not found:
            return None
        run = found[0]
        known = _Known(run.info.run_id, run.info.status, dict(run.data.params), dict(run.data.tags))
        for name in run.data.metrics:
            for metric in self.client.get_metric_history(run.info.run_id, name):
                known.values.setdefault((name, metric.step), []).append(metric.value)
        return known

    def _create(
        self, sweep_id: str, name: str, content: CellContent, tags: dict[str, str]
    ) -> _Known:
        from mlflow.entities import Dataset, DatasetInput, InputTag, Param

        identity = {TAG_SWEEP: sweep_id, TAG_CELL: content.id, **tags}
        run = self.client.create_run(self.experiment_id, content.start_ms, identity, run_name=name)
        run_id = run.info.run_id
        self.client.log_batch(run_id, params=[Param(*item) for item in content.params.items()])
        inputs = [
            DatasetInput(
                Dataset(
                    item.name,
                    item.digest,
                    source_type="dmfc",
                    source=json.dumps({"stages": list(item.stages)}),
                ),
                [InputTag("mlflow.data.context", item.context)],
            )
            for item in content.data
        ]
        if inputs:
            self.client.log_inputs(run_id, inputs)
        for path, text in content.texts.items():
            self.client.log_text(run_id, text, path)
        return _Known(run_id, run.info.status, dict(content.params), identity)

    def _update(self, known: _Known, content: CellContent) -> None:
        from mlflow.entities import Metric, RunTag

        run_id = known.run_id
        for batch in _batches(p for p in content.metrics if (p[0], p[3]) not in known.values):
            self.client.log_batch(run_id, metrics=[Metric(*point) for point in batch])
            for name, value, _, step in batch:
                known.values[name, step] = [value]
        changed = {k: v for k, v in content.tags.items() if known.tags.get(k) != v}
        gone = [k for k in known.tags if k.startswith("dmfc.") and k not in content.tags]
        for name in gone:
            if name not in (TAG_SWEEP, TAG_CELL, TAG_DIGEST):
                self.client.delete_tag(run_id, name)
                del known.tags[name]
        if changed:
            self.client.log_batch(run_id, tags=[RunTag(*item) for item in changed.items()])
            known.tags.update(changed)
        for item in content.files:
            if item not in known.files:
                self.client.log_artifact(run_id, str(item[0]), item[1])
                if content.status not in ENDED:  # at the end the last version of a file counts
                    known.files.add(item)
        if content.status in ENDED:
            # It prints links for a person where the answer for a machine belongs.
            with contextlib.redirect_stdout(io.StringIO()):
                self.client.set_terminated(run_id, content.status, content.end_ms)
        elif known.status != content.status:
            self.client.update_run(run_id, content.status)
        known.status = content.status
        # Last: a run without this tag was not brought up to date whole, and is gone over again.
        self.client.set_tag(run_id, TAG_DIGEST, content.digest)
        known.tags[TAG_DIGEST] = content.digest


def _batches(points: Iterable[Point]) -> Iterable[list[Point]]:
    listed = list(points)
    return (listed[start : start + BATCH] for start in range(0, len(listed), BATCH))
