"""The content of one cell for MLflow, read from the files of its stages."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

import yaml

from dmfc.engine.context import read_attempt, read_progress
from dmfc.engine.ledger import Ledger
from dmfc.engine.record import RECORD
from dmfc.engine.state import SweepState
from dmfc.engine.system import SAMPLES, read_lines
from dmfc.errors import DmfcError
from dmfc.files.digest import json_digest, text_digest
from dmfc.pipeline.artifacts import METRICS, SUMMARY, TRIALS
from dmfc.report.collect import cell_rows
from dmfc.report.rates import rates
from dmfc.report.table import NAMES
from dmfc.sweep.record import CellRecord
from dmfc.sweep.search import objective_of

PARAM_LENGTH = 250
"""MLflow cuts longer values; the whole of them is in config.yaml."""
PICTURES = 12
"""Pictures kept per stage folder."""

Point = tuple[str, float, int, int]
"""Metric name, value, time in ms, step."""
ENDED = ("FINISHED", "FAILED", "KILLED")


@dataclass(frozen=True)
class DataSet:
    """The scenes that a cell learns from or is tested on."""

    name: str
    context: str
    stages: Sequence[str]

    @property
    def digest(self) -> str:
        """Hash of the keys of its shards; MLflow takes 36 characters."""
        return text_digest("\n".join(self.stages))[:32]


@dataclass(frozen=True)
class CellContent:
    """One child run. `digest` changes if and only if anything else here does."""

    id: str
    status: str
    params: dict[str, str]
    metrics: list[Point]
    tags: dict[str, str]
    texts: dict[str, str]
    files: list[tuple[Path, str | None]]
    data: list[DataSet]
    start_ms: int
    end_ms: int

    @property
    def digest(self) -> str:
        """Hash of what the run will show."""
        files = [[path.parts[-3:], where] for path, where in self.files]
        data = [[item.name, item.context, item.digest] for item in self.data]
        shown = [self.status, self.params, self.metrics, self.tags, self.texts, files, data]
        return json_digest(shown)


def cell_content(ledger: Ledger, cell: CellRecord, state: SweepState) -> CellContent:
    """What the ledger holds of a cell, and what its running stages have reported so far."""
    training = [address for address in (cell.pretrain, cell.model) if address]
    wanted = list(cell.stages)
    there = [address for address in wanted if ledger.finished(address)]
    spans = [_span(ledger.record(address)) for address in there]
    began = int(1000 * state.started)
    end = max((end for _, end in spans), default=began)
    status = _status(ledger, cell, wanted, there, state)
    metrics = [point for address in dict.fromkeys(training) for point in _epochs(ledger, address)]
    metrics += _system(ledger, cell.model)
    tags = _tags(ledger, cell, status, state)
    if status == "FINISHED":
        if cell.objective and cell.model:
            value = objective_of(ledger, cell.model, cell.objective)
            metrics += [] if value is None else [("objective", value, end, 0)]
        rows = cell_rows(ledger, cell, {})
        found = rates(rows.rows, rows.trials)
        for name in NAMES:
            value = getattr(found, name).value
            if value is not None:
                metrics.append((name, value, end, 0))
    return CellContent(
        id=cell.run,
        status=status,
        params=_params(cell.config),
        metrics=metrics,
        tags=tags,
        texts={"config.yaml": yaml.safe_dump(cell.config, sort_keys=False)},
        files=list(_files(ledger, wanted)),
        data=[DataSet(item.name, item.context, item.stages) for item in cell.data],
        start_ms=min((start for start, _ in spans), default=began),
        end_ms=end,
    )


def _status(
    ledger: Ledger,
    cell: CellRecord,
    wanted: list[str],
    there: list[str],
    state: SweepState,
) -> str:
    """MLflow's word for how a cell stands."""
    if len(there) == len(wanted):
        return "FINISHED"
    if any(address in state.failures for address in wanted):
        return "FAILED"
    if state.status != "RUNNING":
        return "KILLED" if state.status == "KILLED" else "FAILED"
    begun = there or any(read_attempt(ledger.work(address)) for address in wanted)
    return "RUNNING" if begun else "SCHEDULED"


def _tags(ledger: Ledger, cell: CellRecord, status: str, state: SweepState) -> dict[str, str]:
    tags = {"dmfc.label": cell.label, "dmfc.kind": cell.kind}
    if cell.model:
        tags["dmfc.model_stage"] = cell.model
        if ledger.finished(cell.model):
            tags["mlflow.source.git.commit"] = ledger.record(cell.model)["commit"]
    if status in ENDED:
        failure = cell_rows(ledger, cell, state.failures).failure
        failure = failure or state.failures.get(cell.model or "", "")
        if failure:
            tags["dmfc.failure"] = failure[:4000]
        return tags
    for address in (cell.model, *cell.evaluations):
        if address and read_attempt(ledger.work(address)):
            fraction, message = read_progress(ledger.work(address))
            tags["dmfc.progress"] = f"{address.partition('/')[0]} {fraction:.0%} {message}".strip()
            break
    return tags


def _params(config: Mapping[str, Any], prefix: str = "") -> dict[str, str]:
    """Dotted names and values as text."""
    flat: dict[str, str] = {}
    for name, value in config.items():
        if isinstance(value, Mapping):
            flat.update(_params(value, f"{prefix}{name}."))
        else:
            flat[f"{prefix}{name}"] = str(value)[:PARAM_LENGTH]
    return flat


def _lines(ledger: Ledger, address: str, name: str) -> list[dict[str, Any]]:
    """The lines of a stage's file: finished, or still being written."""
    finished = ledger.finished(address)
    path = (ledger.verified(address) if finished else ledger.work(address)) / name
    try:
        return read_lines(path, growing=not finished)
    except json.JSONDecodeError as error:
        raise DmfcError(f"metrics '{path}' cannot be read: {error}") from error


def _epochs(ledger: Ledger, address: str) -> Iterator[Point]:
    """Metrics per epoch as 'stage/split/name', at the time when the epoch ended."""
    for line in _lines(ledger, address, METRICS):
        step, time_ms = int(line["epoch"]), int(1000 * line["time"])
        for name, value in line.items():
            number = isinstance(value, int | float) and not isinstance(value, bool)
            if number and name not in ("epoch", "time") and math.isfinite(value):
                yield f"{line['stage']}/{line['split']}/{name}", float(value), time_ms, step


def _system(ledger: Ledger, address: str | None) -> Iterator[Point]:
    """Samples of the machine while the model was trained, as MLflow names them."""
    if address is None:
        return
    for step, line in enumerate(_lines(ledger, address, SAMPLES)):
        for name, value in line.items():
            if name != "time":
                yield f"system/{name}", float(value), int(1000 * line["time"]), step


def _span(record: Mapping[str, Any]) -> tuple[int, int]:
    """Start and end of a stage, ms since 1970."""
    start = datetime.fromisoformat(record["started"]).timestamp()
    return int(start * 1000), int((start + float(record["seconds"])) * 1000)


def _files(ledger: Ledger, wanted: list[str]) -> Iterator[tuple[Path, str | None]]:
    """Trial rows, summaries and pictures of what is finished, under its stage's kind and place."""
    there = [(place, item) for place, item in enumerate(wanted) if ledger.finished(item)]
    for _, address in there:
        scenes = ledger.record(address)["inputs"].get("scenes")
        if isinstance(scenes, str):  # the shard that an evaluation was made on
            for picture in sorted(ledger.verified(scenes).glob("*.png")):
                yield picture, "scenes"
    for place, address in there:
        folder, where = ledger.verified(address), f"{place:02d}-{address.split('/')[0]}"
        for name in (TRIALS, SUMMARY, METRICS, RECORD):
            if (folder / name).is_file():
                yield folder / name, where
        for picture in sorted(folder.rglob("*.png"))[:PICTURES]:
            yield picture, f"{where}/pictures"
