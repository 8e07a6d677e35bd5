"""`dmfc ui` as a process, in places that are not as nice as a fresh checkout."""

import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import threading
import urllib.request
from pathlib import Path

import psutil
import pytest

from dmfc.tracking.project import project_sweep
from tests.tracking.conftest import FinishedSweep

pytestmark = pytest.mark.full
ROOT = Path(__file__).resolve().parents[2]
CODE = "import sys; sys.path.append(sys.argv.pop(1)); from dmfc.cli.main import main; main()"
PATIENCE = 600.0
DIRECT = urllib.request.build_opener(urllib.request.ProxyHandler({}))


def start(store: Path, folder: Path, **kwargs) -> subprocess.Popen:
    """`dmfc ui`, as the installed command has it: without the folder among its modules."""
    environment = {**os.environ, "PYTHONUNBUFFERED": "1", **kwargs.pop("env", {})}
    return subprocess.Popen(
        [sys.executable, "-P", "-c", CODE, str(ROOT), "ui", "--port", "0", "--store", store],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        cwd=folder,
        env=environment,
        **kwargs,
    )


def address(server: subprocess.Popen) -> str:
    """Where it serves, once it does."""
    watchdog = threading.Timer(PATIENCE, server.kill)
    watchdog.start()
    assert server.stdout is not None
    found = ""
    for line in server.stdout:
        if line.startswith("MLflow: "):
            found = line.split()[1]
        if line.startswith("Ctrl-C"):
            break
    watchdog.cancel()
    assert found, server.communicate()
    return found


def run_names(at: str) -> set[str]:
    body = json.dumps({"experiment_ids": ["1"]}).encode()
    call = urllib.request.Request(
        f"{at}/api/2.0/mlflow/runs/search", body, {"Content-Type": "application/json"}
    )
    with DIRECT.open(call) as answer:
        return {run["info"]["run_name"] for run in json.load(answer)["runs"]}


def test_behind_a_proxy_beside_strange_modules_in_a_strange_place_until_sigterm(
    tmp_path, empty_database
):
    """The proxy refuses; the modules end whoever imports them; the store's path must be quoted."""
    place = tmp_path / "lab 50%20? #1"
    place.mkdir()
    sweep = FinishedSweep(place)
    (sweep.ledger.store / "mlflow").mkdir()
    shutil.copy(empty_database, sweep.ledger.store / "mlflow")
    project_sweep(sweep.ledger, sweep.id)
    folder = tmp_path / "folder"
    folder.mkdir()
    for name in ("random", "email", "types", "secrets", "mlflow", "uvicorn", "fastapi"):
        (folder / f"{name}.py").write_text("raise SystemExit('the file of the user was run')\n")
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))  # nobody listens
        proxy = f"http://127.0.0.1:{taken.getsockname()[1]}"
        names = ("http_proxy", "HTTP_PROXY", "https_proxy", "all_proxy")
        server = start(sweep.ledger.store, folder, env=dict.fromkeys(names, proxy))
        assert sweep.id in run_names(address(server))
    children = psutil.Process(server.pid).children(recursive=True)
    assert children
    server.send_signal(signal.SIGTERM)
    out, err = server.communicate(timeout=PATIENCE)
    assert server.returncode == 0
    assert (out, err) == ("ended\n", "")
    _, alive = psutil.wait_procs(children, timeout=PATIENCE)
    assert alive == []
    assert not list(folder.glob("*/")) or [p.name for p in folder.glob("*/")] == ["__pycache__"]
    assert {item.name for item in tmp_path.iterdir()} == {place.name, "folder"}


@pytest.fixture
def read_only(finished, tmp_path):
    """A finished store on a file system that is mounted read-only, at another place."""
    project_sweep(finished.ledger, finished.id)
    return finished.ledger.store


MOUNT = (
    'mkdir -p "$1" && mount --bind "$0" "$1" && mount -o remount,bind,ro "$1" && shift && exec "$@"'
)


def on_read_only(store: Path, at: Path, *command: object) -> list[str]:
    """The command with the store at `at`, mounted read-only in a namespace of its own."""
    return ["unshare", "--mount", "sh", "-c", MOUNT, str(store), str(at), *map(str, command)]


def test_a_read_only_store_shows_its_tables_and_runs(read_only, tmp_path, finished):
    at = tmp_path / "read only"
    command = [sys.executable, "-P", "-c", CODE, ROOT]
    shown = subprocess.run(
        on_read_only(read_only, at, *command, "tables", "tiny", "--store", at),
        capture_output=True,
        text=True,
        check=False,
    )
    assert shown.returncode == 0, shown.stderr
    assert "A tiny sweep" in shown.stdout
    assert "not written: " in shown.stderr
    assert "Traceback" not in shown.stderr
    status = subprocess.run(
        on_read_only(read_only, at, *command, "sweep", "status", "--store", at, "--json"),
        capture_output=True,
        text=True,
        check=True,
    )
    assert json.loads(status.stdout)[0]["status"] == "FAILED"
    server = subprocess.Popen(
        on_read_only(read_only, at, *command, "ui", "--port", "0", "--store", at),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONUNBUFFERED": "1"},
    )
    assert finished.id in run_names(address(server))
    server.send_signal(signal.SIGTERM)
    server.communicate(timeout=PATIENCE)
    assert server.returncode == 0
