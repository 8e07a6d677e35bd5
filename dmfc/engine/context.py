"""The argument of a stage's function: settings, inputs, where to write, how to report progress."""

from __future__ import annotations

import json
import os
import platform
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import Any

from dmfc.files.atomic import write_json

ATTEMPT = "attempt.json"
_ATTEMPT_KEYS = {"attempt", "host", "pid", "started"}
PROGRESS_SECONDS = 0.5
"""Least time between two writes of a stage's progress."""


@dataclass
class StageContext:
    """The one argument of a stage's function.

    `out` is empty and becomes the finished stage when the function returns; `work` persists over
    attempts (checkpoints); inputs are finished folders, read-only. `cpus` and `gpus` are granted.
    """

    kind: str
    name: str
    key: str
    config: Mapping[str, Any]
    inputs: Mapping[str, Path | list[Path]]
    out: Path
    work: Path
    cpus: int = 1
    gpus: float = 0.0
    hints: Mapping[str, str] = field(default_factory=dict)
    _last_write: float = field(default=0.0, repr=False)

    @property
    def store(self) -> Path:
        """The store that the stage lies in."""
        return self.work.parents[1]

    def input(self, name: str) -> Path:
        """The folder of the single input `name`."""
        folder = self.inputs[name]
        if isinstance(folder, list):
            raise TypeError(f"input '{name}' of {self.kind} is a list of folders")
        return folder

    def input_list(self, name: str) -> list[Path]:
        """The folders of the input `name`, which has several."""
        folders = self.inputs[name]
        return folders if isinstance(folders, list) else [folders]

    def progress(self, fraction: float, message: str = "") -> None:
        """Tell whoever watches: `fraction` in [0, 1] done, and what is being done. Cheap."""
        now = time.monotonic()
        if now - self._last_write < PROGRESS_SECONDS:
            return
        self._last_write = now
        progress = {"fraction": float(fraction), "message": message}
        write_json(progress_file(self.work), progress, durable=False)


def progress_file(work: Path) -> Path:
    """Where the stage with this work folder reports its progress."""
    return work / "progress.json"


def read_progress(work: Path) -> tuple[float, str]:
    """Last fraction and message of this work folder; (0, '') before the first."""
    try:
        progress = json.loads(progress_file(work).read_bytes())
        return float(progress["fraction"]), str(progress["message"])
    except (FileNotFoundError, ValueError, KeyError, TypeError):  # none yet, or a power cut
        return 0.0, ""


def tell_attempt(work: Path, attempt: str, started: datetime, node: str = "") -> None:
    """Say that a process has begun this stage: which attempt, where (Ray's id too) and when."""
    entry = {"attempt": attempt, "host": platform.node(), "pid": os.getpid(), "node": node}
    write_json(work / ATTEMPT, {**entry, "started": started.timestamp()}, durable=False)


def read_attempt(work: Path) -> dict[str, Any]:
    """What `tell_attempt` wrote last; empty if no process has begun this stage.

    Empty too where the file is damaged: whoever wrote it is gone since.
    """
    try:
        entry = json.loads((work / ATTEMPT).read_bytes())
    except (FileNotFoundError, ValueError):
        return {}
    return entry if isinstance(entry, dict) and entry.keys() >= _ATTEMPT_KEYS else {}
