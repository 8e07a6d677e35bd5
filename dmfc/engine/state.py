"""The state of a sweep: its running drivers, how the last one ended, and failures.

A driver holds a lock while it lives. A mark whose lock is free belongs to a killed driver.
"""

from __future__ import annotations

import json
import os
import platform
import time
import uuid
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from filelock import FileLock

from dmfc.files.atomic import write_json
from dmfc.files.locks import is_held
from dmfc.files.sealed import read_or_replace, write_sealed

STATE = "state.json"
SEALED_VERSION = 2
"""Version of state, plan and marks of a sweep since which they hold their own digest."""
Status = Literal["UNSTARTED", "RUNNING", "FINISHED", "FAILED", "KILLED"]


@dataclass(frozen=True)
class SweepState:
    """`failures`: reason by address of a stage; `started`: of the first driver, s since 1970."""

    status: Status = "UNSTARTED"
    failures: Mapping[str, str] = field(default_factory=dict)
    started: float = 0.0
    drivers: Sequence[str] = ()
    """'host:pid' of the living ones."""


def read_state(folder: Path) -> SweepState:
    """How the sweep of that folder stands now. A damaged state is warned of and forgotten."""
    stored = read_or_replace(folder / STATE, SEALED_VERSION) or {}
    living, dead = _drivers(folder)
    status: Status = stored.get("status", "UNSTARTED")
    if living:
        status = "RUNNING"
    elif dead or status == "RUNNING":
        status = "KILLED"
    names = [f"{mark['host']}:{mark['pid']}" for mark in living]
    return SweepState(status, stored.get("failures", {}), stored.get("started", 0.0), names)


def write_state(folder: Path, status: Status, failures: Mapping[str, str]) -> None:
    """Say how the sweep stands, as this driver sees it."""
    started = read_state(folder).started or time.time()
    stored = {"status": status, "failures": dict(failures), "started": started}
    write_sealed(folder / STATE, SEALED_VERSION, stored)


@contextmanager
def driving(folders: Sequence[Path]) -> Iterator[None]:
    """Be a driver of these sweeps: leaves a mark in each while it lives, and clears dead ones."""
    with ExitStack() as stack:
        for folder in folders:
            marks = folder / "drivers"
            marks.mkdir(parents=True, exist_ok=True)
            name = f"{platform.node()}-{os.getpid()}-{uuid.uuid4().hex[:8]}"
            lock = stack.enter_context(FileLock(marks / f"{name}.lock"))
            mark = {"host": platform.node(), "pid": os.getpid()}
            write_json(marks / f"{name}.json", mark, durable=False)  # of this life alone
            stack.callback(Path(lock.lock_file).unlink, missing_ok=True)
            stack.callback((marks / f"{name}.json").unlink, missing_ok=True)
            for path in _dead(marks):
                path.unlink(missing_ok=True)
                path.with_suffix(".lock").unlink(missing_ok=True)
        yield


def _drivers(folder: Path) -> tuple[list[dict], list[Path]]:
    """Marks of living drivers, and files of dead ones."""
    marks = folder / "drivers"
    dead = _dead(marks)
    living = []
    for path in marks.glob("*.json"):
        if path not in dead:
            try:
                living.append(json.loads(path.read_text()))
            except (FileNotFoundError, ValueError):  # it ended just now, or is damaged
                continue
    return living, dead


def _dead(marks: Path) -> list[Path]:
    return [path for path in marks.glob("*.json") if not is_held(path.with_suffix(".lock"))]
