"""One attempt at one stage, in whatever process it is run: Ray's worker or the driver itself."""

from __future__ import annotations

import dataclasses
import importlib
import os
import platform
import sys
import time
import traceback
import uuid
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Literal

from dmfc.engine.context import StageContext, tell_attempt
from dmfc.engine.ledger import Ledger
from dmfc.engine.stage import plain
from dmfc.engine.system import keep_samples, sampled
from dmfc.errors import DmfcError, first_line, masked

ERROR_LOG = "error.txt"


@dataclass(frozen=True)
class Job:
    """All that a worker needs to run one stage; small, and nothing of it is shared memory."""

    store: str
    kind: str
    name: str
    key: str
    version: int
    entry: str
    config: Mapping[str, Any]
    input_keys: Mapping[str, str | list[str]]
    cpus: int
    gpus: float
    commit: str
    memory_gb: float = 0.0
    seconds: float = 0.0
    may_fail: bool = False
    system_seconds: float = 0.0
    attempt: str = field(default_factory=lambda: uuid.uuid4().hex)
    hints: Mapping[str, str] = field(default_factory=dict)

    @property
    def address(self) -> str:
        """'kind/key'."""
        return f"{self.kind}/{self.key}"


@dataclass(frozen=True)
class Outcome:
    """What became of a stage. `reason` is one line; `seconds` is the time its function took.

    done: was there; ran: made now; failed: its function raised; died: its process did (may be tried
    again); blocked: an input failed; interrupted: not finished when the driver was stopped.
    """

    status: Literal["done", "ran", "failed", "died", "blocked", "interrupted"]
    reason: str = ""
    seconds: float = 0.0
    kept: bool = False
    """Failed, and the ledger holds the failure: users can go on without."""

    @property
    def ok(self) -> bool:
        """Whether the stage's outputs are there."""
        return self.status in ("done", "ran")


def execute(job: Job) -> Outcome:
    """Run the stage unless it is finished. An error is a value, its traceback a file in `work`."""
    ledger = Ledger(Path(job.store))
    try:
        with ledger.claim(job.address) as out:
            if out is None:
                return Outcome("done")
            return _attempt(job, ledger, out)
    except Exception as error:
        return Outcome("failed", reason=_explain(error, ledger.work(job.address)))


def give_up(job: Job, ledger: Ledger, outcome: Outcome) -> Outcome:
    """Keep the failure of a stage that may fail and whose process died or was stopped."""
    with ledger.claim(job.address) as out:
        if out is None:
            return Outcome("done")
        record = _record(job, datetime.now(UTC), outcome.seconds)
        ledger.commit_failure(job.address, record, outcome.reason)
    return dataclasses.replace(outcome, kept=True)


def _attempt(job: Job, ledger: Ledger, out: Path) -> Outcome:
    """Run the claimed stage to its end."""
    started, clock, work = datetime.now(UTC), time.perf_counter(), ledger.work(job.address)
    tell_attempt(work, job.attempt, started)
    _limit_threads(job.cpus)
    try:
        with sampled(work, job.system_seconds, job.gpus):
            _load(job.entry)(_context(job, ledger, out))
    except (OSError, MemoryError):
        raise  # of this machine, not of the stage
    except Exception as error:
        if not job.may_fail:
            raise
        seconds, reason = time.perf_counter() - clock, _reason(error)
        ledger.commit_failure(job.address, _record(job, started, seconds), reason)
        return Outcome("failed", reason, seconds, kept=True)
    keep_samples(work, out)
    seconds = time.perf_counter() - clock
    ledger.commit(job.address, _record(job, started, seconds))
    return Outcome("ran", seconds=seconds)


def _context(job: Job, ledger: Ledger, out: Path) -> StageContext:
    inputs: dict[str, Path | list[Path]] = {
        name: [ledger.folder(item) for item in given]
        if isinstance(given, list)
        else ledger.folder(given)
        for name, given in job.input_keys.items()
    }
    work = ledger.work(job.address)
    return StageContext(
        job.kind, job.name, job.key, job.config, inputs, out, work, job.cpus, job.gpus, job.hints
    )


def _record(job: Job, started: datetime, seconds: float) -> dict[str, Any]:
    return {
        "kind": job.kind,
        "name": job.name,
        "key": job.key,
        "stage_version": job.version,
        "config": plain(job.config),
        "inputs": dict(job.input_keys),
        "started": started.isoformat(timespec="seconds"),
        "seconds": round(seconds, 4),
        "host": platform.node(),
        "cpus": job.cpus,
        "gpus": job.gpus,
        "commit": job.commit,
        "python": platform.python_version(),
    }


def _load(entry: str) -> Any:
    """The function at 'package.module:name'."""
    module, _, name = entry.partition(":")
    return getattr(importlib.import_module(module), name)


def _limit_threads(cpus: int) -> None:
    """Let this process compute on `cpus` threads: on a shared machine more of them collapse."""
    for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ[variable] = str(cpus)
    torch = sys.modules.get("torch")
    if torch is not None:
        torch.set_num_threads(cpus)
    numba = sys.modules.get("numba")
    if numba is not None:
        numba.set_num_threads(min(cpus, numba.config.NUMBA_NUM_THREADS))


def _explain(error: Exception, work: Path) -> str:
    """One line for the user; the traceback goes to a file."""
    try:
        work.mkdir(parents=True, exist_ok=True)
        (work / ERROR_LOG).write_text("".join(traceback.format_exception(error)))
    except OSError as unwritten:
        return f"{type(error).__name__}: {error} (traceback not written: {unwritten.strerror})"
    line = _reason(error)
    return line if isinstance(error, DmfcError) else f"{line} (traceback: {work / ERROR_LOG})"


def _reason(error: Exception) -> str:
    line, kind = masked(first_line(error)), type(error).__name__
    return line if isinstance(error, DmfcError) or line == kind else f"{kind}: {line}"
