"""MLflow while a sweep runs: a process beside the driver writes, and outlives it.

The driver only holds a pipe to it. When the pipe closes for any reason, the process brings
MLflow up to date a last time and ends. So the runs of a killed driver are shown as killed.
"""

from __future__ import annotations

import contextlib
import json
import select
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

from dmfc.engine.ledger import Ledger
from dmfc.errors import DmfcError

END_SECONDS = 120.0
"""Time that the driver waits for the last update."""
INTERRUPTED_SECONDS = 4.0
"""The same after Ctrl-C or SIGTERM, when little time may be left; `dmfc ui` makes up for it."""
DEATH_SECONDS = 2.0
"""Time after the pipe closed in which a killed driver's lock is freed."""
ROOT = Path(__file__).resolve().parents[2]
"""Where the package is."""
CODE = "import sys; sys.path.append(sys.argv[1]); from dmfc.tracking.live import main; main()"


class LiveTracking:
    """The driver's end: starts the writer when a sweep takes longer than one interval."""

    def __init__(self, ledger: Ledger, sweep_ids: Sequence[str], uri: str, seconds: float) -> None:
        self._ledger, self._sweep_ids = ledger, list(sweep_ids)
        self._uri, self._seconds = uri, seconds
        self._due = time.monotonic() + seconds if seconds > 0 else float("inf")
        self._process: subprocess.Popen | None = None

    def tick(self) -> None:
        """Call often: starts the writer once it is due."""
        if self._process is None and time.monotonic() >= self._due:
            self._start()

    def finish(self, seconds: float = END_SECONDS) -> None:
        """Let the writer make its last update, and wait so long for it."""
        if self._process is None or self._process.stdin is None:
            return
        with contextlib.suppress(BrokenPipeError):
            self._process.stdin.close()
        try:
            self._process.wait(seconds)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    def _start(self) -> None:
        # -P: a `random.py` of the user's in this folder is none of its modules.
        command = [sys.executable, "-P", "-c", CODE, str(ROOT)]
        self._ledger.prepare()
        with (self._ledger.store / "work" / "tracking.log").open("a") as log:
            # A session of its own: Ctrl-C in the terminal is the driver's business.
            self._process = subprocess.Popen(
                command, stdin=subprocess.PIPE, stdout=log, stderr=log, start_new_session=True
            )
        # Not as arguments, which all users of the machine can read: the URI may have a password.
        given = [str(self._ledger.store), self._uri, self._seconds, self._sweep_ids]
        assert self._process.stdin is not None
        with contextlib.suppress(BrokenPipeError):
            self._process.stdin.write(f"{json.dumps(given)}\n".encode())
            self._process.stdin.flush()


def write_until_closed(store: Path, uri: str, seconds: float, sweep_ids: Sequence[str]) -> None:
    """Bring MLflow up to date every so many seconds until standard input closes, and once more."""
    from dmfc.engine.state import read_state
    from dmfc.tracking.project import project_sweep
    from dmfc.tracking.writer import Writer

    ledger = Ledger(store)
    writers: dict[str, Writer] = {}

    def writer(place: str) -> Writer:
        return writers.setdefault(place, writers.get(place) or Writer(place))

    closed = False
    while not closed:
        for sweep_id in sweep_ids:
            try:
                project_sweep(ledger, sweep_id, uri, writer)
            except DmfcError as error:
                print(error, flush=True)
        closed = bool(select.select([sys.stdin], [], [], seconds)[0])
    end = time.monotonic() + DEATH_SECONDS
    for sweep_id in sweep_ids:
        folder = ledger.store / "sweeps" / sweep_id
        while read_state(folder).status == "RUNNING" and time.monotonic() < end:
            time.sleep(0.1)
        project_sweep(ledger, sweep_id, uri, writer)


def main() -> None:
    """The process: what to write is the first line of standard input."""
    store, uri, seconds, sweep_ids = json.loads(sys.stdin.readline())
    write_until_closed(Path(store), uri, seconds, sweep_ids)
