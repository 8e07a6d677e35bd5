"""What MLflow is told about one cell, read from the files of its stages."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

import yaml

from dmfc.errors import DmfcError
from dmfc.report.table import NAMES, SweepTable
from dmfc.sweep.ledger import Ledger

PARAM_LENGTH = 250
"""MLflow cuts longer values; the whole of them is in config.yaml."""
PICTURES = 12
"""Pictures kept per stage folder."""

Point = tuple[str, float, int, int]
"""Metric name, value, time in ms, step."""


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
    start_ms: int | None
    end_ms: int | None

    @property
    def digest(self) -> str:
        """Hash of what the run will show."""
        files = [str(path) for path, _ in self.files]
        shown = [self.status, self.params, self.metrics, self.tags, self.texts, files]
        return hashlib.sha256(json.dumps(shown, sort_keys=True).encode()).hexdigest()


def cell_content(ledger: Ledger, cell: Mapping[str, Any], table: SweepTable) -> CellContent:
    """Read what the ledger holds of a cell; a cell whose stages are missing is FAILED."""
    training = [address for address in (cell["pretrain"], cell["model"]) if address]
    wanted = [*training, *cell["evaluations"]]
    there = [address for address in wanted if ledger.finished(address)]
    spans = [_span(ledger.record(address)) for address in there]
    row = next(row for row in table.rows if row.name == cell["name"])
    end = max((end for _, end in spans), default=None)
    metrics = [
        point
        for address in training
        if address in there
        for point in _epochs(
            ledger.folder(address) / "metrics.jsonl", _span(ledger.record(address))
        )
    ]
    for name in NAMES:
        value = row.rate(name).value
        if value is not None:
            metrics.append((name, value, end or 0, 0))
    return CellContent(
        id=f"{cell['name']}-seed{cell['seed']}",
        status="FINISHED" if len(there) == len(wanted) else "FAILED",
        params=_params(cell["config"]),
        metrics=metrics,
        tags=_tags(cell, row.failure),
        texts={"config.yaml": yaml.safe_dump(cell["config"], sort_keys=False)},
        files=list(_files(ledger, there)),
        start_ms=min((start for start, _ in spans), default=None),
        end_ms=end,
    )


def _tags(cell: Mapping[str, Any], failure: str) -> dict[str, str]:
    tags = {"dmfc.label": cell["label"], "dmfc.kind": cell["kind"]}
    if cell["model"]:
        tags["dmfc.model_stage"] = cell["model"]
    if failure:
        tags["dmfc.failure"] = failure[:4000]
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


def _epochs(path: Path, span: tuple[int, int]) -> Iterator[Point]:
    """Metrics per epoch as 'stage/split/name'; their times are spread over the stage's."""
    if not path.is_file():
        return
    try:
        lines = [json.loads(line) for line in path.read_text().splitlines() if line.strip()]
    except json.JSONDecodeError as error:
        raise DmfcError(f"metrics '{path}' cannot be read: {error}") from error
    last = max((int(line["epoch"]) for line in lines), default=0) + 1
    for line in lines:
        step = int(line["epoch"])
        time_ms = span[0] + (span[1] - span[0]) * (step + 1) // last
        for name, value in line.items():
            number = isinstance(value, int | float) and not isinstance(value, bool)
            if number and name != "epoch" and math.isfinite(value):
                yield f"{line['stage']}/{line['split']}/{name}", float(value), time_ms, step


def _span(record: Mapping[str, Any]) -> tuple[int, int]:
    """Start and end of a stage, ms since 1970."""
    start = datetime.fromisoformat(record["started"]).timestamp()
    return int(start * 1000), int((start + float(record["seconds"])) * 1000)


def _files(ledger: Ledger, addresses: list[str]) -> Iterator[tuple[Path, str | None]]:
    """Trial rows, summaries and pictures, each under its stage's kind and place."""
    for address in addresses:
        scenes = ledger.record(address)["inputs"].get("scenes")
        if isinstance(scenes, str):  # the shard that an evaluation was made on
            for picture in sorted(ledger.folder(scenes).glob("*.png")):
                yield picture, "scenes"
    for place, address in enumerate(addresses):
        folder, where = ledger.folder(address), f"{place:02d}-{address.split('/')[0]}"
        for name in ("trials.parquet", "summary.json", "metrics.jsonl", "stage.json"):
            if (folder / name).is_file():
                yield folder / name, where
        for picture in sorted(folder.rglob("*.png"))[:PICTURES]:
            yield picture, f"{where}/pictures"
