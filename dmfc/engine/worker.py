"""One attempt at one stage, in a worker of Ray or in the driver itself."""

from __future__ import annotations

import dataclasses
import faulthandler
import importlib
import os
import platform
import sys
import time
import traceback
import uuid
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Literal

from dmfc.engine.context import StageContext, tell_attempt
from dmfc.engine.ledger import Ledger
from dmfc.engine.stage import plain
from dmfc.engine.system import keep_samples, sampled
from dmfc.errors import DmfcError, MachineError, first_line, masked, of_machine

ERROR_LOG = "error.txt"
CRASH_LOG = "crash.txt"
"""Where a process that crashes on a stage leaves its signal and stack."""


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
    avoid: tuple[str, ...] = ()
    """Ray's ids of the nodes that must not run it."""
    sign: str = ""
    """A file of this run in the store: a machine where it is missing sees another store."""

    @property
    def address(self) -> str:
        """'kind/key'."""
        return f"{self.kind}/{self.key}"


Status = Literal[
    "done", "ran", "failed", "died", "machine", "cut", "unmet", "blocked", "interrupted"
]


@dataclass(frozen=True)
class Outcome:
    """What became of a stage. `reason` is one line; `seconds` is the time its function took.

    done: was there; ran: made now; failed: its function raised; died: its process did (may be tried
    again); machine: the machine failed, not the stage (tried again on another one); cut: its node
    no longer answers (tried again); unmet: no node can give what it asks for; blocked: an input
    failed; interrupted: not finished when the driver was stopped.
    """

    status: Status
    reason: str = ""
    seconds: float = 0.0
    node: str = ""
    """Ray's id of the node it was run on, where that is known."""
    host: str = ""
    kept: bool = False
    """Failed, and the ledger holds the failure: users can go on without."""

    @property
    def ok(self) -> bool:
        """Whether the stage's outputs are there."""
        return self.status in ("done", "ran")


def execute(job: Job, node: str = "", waits: Callable[[], None] = lambda: None) -> Outcome:
    """Run the stage unless it is finished. An error is a value, its traceback a file in `work`.

    `node` is Ray's id of this one. `waits` is called where another process is at work on the stage.
    """
    ledger = Ledger(Path(job.store))
    try:
        _require_store(job, ledger)
        with ledger.claim(job.address, waits) as out:
            outcome = Outcome("done") if out is None else _attempt(job, ledger, out, node)
    except Exception as error:
        status: Literal["machine", "failed"] = "machine" if of_machine(error) else "failed"
        outcome = Outcome(status, reason=_explain(error, ledger.work(job.address)))
    return dataclasses.replace(outcome, node=node, host=platform.node())


def _require_store(job: Job, ledger: Ledger) -> None:
    """Raise MachineError where this machine does not see the driver's store."""
    if job.sign and not (ledger.store / job.sign).exists():
        raise MachineError(
            f"the store '{ledger.store}' of {platform.node()} is not the driver's: a shared folder "
            "that is not mounted there? (--store)"
        )


def crash_in(work: Path) -> str:
    """'Segmentation fault' if the last process on a stage crashed by itself; '' if it was killed.

    `work` is the stage's work folder.
    """
    try:
        first = (work / CRASH_LOG).read_text().partition("\n")[0]
    except FileNotFoundError:
        return ""
    return first.rpartition("error: ")[2]


@contextmanager
def _crash_reported(work: Path) -> Iterator[None]:
    """While it lasts, a crash of this process (not its being killed) leaves `CRASH_LOG`."""
    enabled = faulthandler.is_enabled()
    with (work / CRASH_LOG).open("w") as log:
        faulthandler.enable(log, all_threads=False)
        try:
            yield
        finally:
            faulthandler.disable()
            if enabled:
                faulthandler.enable()


def give_up(job: Job, ledger: Ledger, outcome: Outcome) -> Outcome:
    """Keep the failure of a stage that may fail and whose process crashed or was stopped."""
    with ledger.claim(job.address) as out:
        if out is None:
            return Outcome("done")
        record = _record(job, datetime.now(UTC), outcome.seconds)
        ledger.commit_failure(job.address, record, outcome.reason)
    return dataclasses.replace(outcome, kept=True)


def _attempt(job: Job, ledger: Ledger, out: Path, node: str) -> Outcome:
    """Run the claimed stage to its end."""
    started, clock, work = datetime.now(UTC), time.perf_counter(), ledger.work(job.address)
    tell_attempt(work, job.attempt, started, node)
    _limit_threads(job.cpus)
    context = _context(job, ledger, out)  # damaged inputs are no failure of this stage
    # In a worker of Ray alone: the process of a driver has its own ways to tell a crash.
    crashes = _crash_reported(work) if node else nullcontext()
    try:
        with crashes, sampled(work, job.system_seconds, job.gpus):
            _load(job.entry)(context)
    except Exception as error:
        if not job.may_fail or of_machine(error):
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
        name: [ledger.verified(item) for item in given]
        if isinstance(given, list)
        else ledger.verified(given)
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
