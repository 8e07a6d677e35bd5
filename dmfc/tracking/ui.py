"""The launcher of MLflow's pages."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from dmfc.engine.ledger import Ledger
from dmfc.errors import DmfcError
from dmfc.tracking.store import artifact_root, database, tracking_uri

HOST = "127.0.0.1"
START_SECONDS = 300.0


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

    Raises DmfcError if the store has no runs yet, or the server does not come up.
    """
    if not uri and not database(ledger).is_file():
        raise DmfcError(f"no runs in the store '{ledger.store}' yet: run `dmfc sweep` first")
    port = free_port(port)
    command = [
        sys.executable, "-m", "mlflow", "server",
        "--backend-store-uri", uri or tracking_uri(ledger),
        "--default-artifact-root", artifact_root(ledger).as_uri(),
        "--host", HOST, "--port", str(port), "--workers", "1",
    ]  # fmt: skip
    log = log or ledger.store / "mlflow" / "server.log"
    address = f"http://{HOST}:{port}"
    with log.open("w") as output:
        server = subprocess.Popen(
            command,
            stdout=output,
            stderr=subprocess.STDOUT,
            env={**os.environ, "MLFLOW_DISABLE_TELEMETRY": "true"},
        )
        try:
            _wait(server, address, log)
            yield address
        finally:
            server.terminate()
            try:
                server.wait(10)
            except subprocess.TimeoutExpired:
                server.kill()
                server.wait()


def run_page(address: str, experiment_id: str, run_id: str) -> str:
    """The page of one run."""
    return f"{address}/#/experiments/{experiment_id}/runs/{run_id}"


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
