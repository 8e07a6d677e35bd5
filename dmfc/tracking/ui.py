"""Starts the server of MLflow's pages."""

from __future__ import annotations

import contextlib
import os
import signal
import socket
import subprocess
import sys
import tempfile
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from dmfc.engine.ledger import Ledger
from dmfc.errors import DmfcError
from dmfc.tracking.moved import copy_database, set_locations
from dmfc.tracking.store import (
    artifacts_beside,
    database,
    reach_loopback_directly,
    sqlite_path,
    sqlite_uri,
)

HOST = "127.0.0.1"
START_SECONDS = 300.0
END_SECONDS = 5.0
"""Time that the server has to end by itself."""


def free_port(wanted: int) -> int:
    """`wanted` if nothing listens there; any free port for 0. Raises DmfcError if it is taken."""
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((HOST, wanted))
        except OSError as error:
            raise DmfcError(
                f"port {wanted} on {HOST} is taken; choose another by --port"
            ) from error
        return int(probe.getsockname()[1])


@contextmanager
def serve(ledger: Ledger, port: int, uri: str = "", log: Path | None = None) -> Iterator[str]:
    """Run MLflow's server on localhost; gives its address once it answers.

    Of a store that cannot be written it shows a copy of the runs. Raises DmfcError if the store
    has no runs yet, or the server does not come up.
    """
    path = sqlite_path(uri) if uri else database(ledger)
    if not uri and not database(ledger).is_file():
        raise DmfcError(f"no runs in the store '{ledger.store}' yet: run `dmfc sweep` first")
    port = free_port(port)
    with contextlib.ExitStack() as stack:
        folder = database(ledger).parent
        if path is not None:
            if not _writable(path):
                folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
                copy_database(path, folder / path.name)
                set_locations(folder / path.name, artifacts_beside(path))
                path = folder / path.name
            else:
                set_locations(path, artifacts_beside(path))
            uri = sqlite_uri(path)
        log = log or folder / "server.log"
        yield stack.enter_context(_server(port, uri, artifacts_beside(path or log), log))


@contextmanager
def _server(port: int, uri: str, artifacts: Path, log: Path) -> Iterator[str]:
    """MLflow's server and all processes that it starts; gives its address."""
    # -P and cwd: a `random.py` of the user's in this folder is none of its modules.
    command = [
        sys.executable, "-P", "-m", "mlflow", "server",
        "--backend-store-uri", uri,
        "--default-artifact-root", artifacts.as_uri(),
        "--host", HOST, "--port", str(port), "--workers", "1",
    ]  # fmt: skip
    reach_loopback_directly()
    address = f"http://{HOST}:{port}"
    with log.open("w") as output:
        server = subprocess.Popen(
            command,
            stdout=output,
            stderr=subprocess.STDOUT,
            env={**os.environ, "MLFLOW_DISABLE_TELEMETRY": "true", "PYTHONSAFEPATH": "1"},
            cwd=log.parent,
            start_new_session=True,  # with its workers it ends as one group, and by us alone
        )
        try:
            _wait(server, address, log)
            yield address
        finally:
            _end(server)


def run_page(address: str, experiment_id: str, run_id: str) -> str:
    """The page of one run."""
    return f"{address}/#/experiments/{experiment_id}/runs/{run_id}"


def _writable(path: Path) -> bool:
    """Whether the database can be written, and files made beside it."""
    try:
        with path.open("r+b"), tempfile.TemporaryFile(dir=path.parent):
            return True
    except OSError:
        return False


def _end(server: subprocess.Popen) -> None:
    """End a server and what it started."""
    with contextlib.suppress(ProcessLookupError):
        os.killpg(server.pid, signal.SIGTERM)
    with contextlib.suppress(subprocess.TimeoutExpired):
        server.wait(END_SECONDS)
    with contextlib.suppress(ProcessLookupError):
        os.killpg(server.pid, signal.SIGKILL)
    server.wait()


def _wait(server: subprocess.Popen, address: str, log: Path) -> None:
    end = time.monotonic() + START_SECONDS
    while time.monotonic() < end:
        if server.poll() is not None:
            break
        try:
            with urllib.request.urlopen(f"{address}/health", timeout=2):
                return
        except (urllib.error.URLError, OSError):
            time.sleep(0.3)
    raise DmfcError(f"MLflow's server did not come up; its output is in '{log}'")
