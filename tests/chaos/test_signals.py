"""A sweep that is to end, or loses the head of its cluster: the line that resumes, no orphans.

Its Ray is the one that `dmfc` starts on this machine, so who may use that is looked at too.
"""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import psutil
import pytest

from dmfc.engine.state import read_state
from tests.chaos.held import HELD

pytestmark = pytest.mark.chaos
HERE = Path(__file__).resolve().parent
PATIENCE = 600.0
"""Seconds for each step: a bound for what hangs, not for a busy machine."""
SWEEP = "name: ended\ncells: {pretrained: {model: pretrained}}\n"


class Driver:
    """`dmfc sweep` on a Ray of its own, whose training waits while there is a file."""

    def __init__(self, folder: Path, database: Path, **environment: str) -> None:
        self.store, path = folder / "store", folder / "ended.yaml"
        (self.store / "mlflow").mkdir(parents=True)
        (self.store / "mlflow" / "mlflow.db").write_bytes(database.read_bytes())
        (self.store / "hold-pretrain").touch()
        path.write_text(SWEEP)
        self.line = ["sweep", str(path), "--preset", "smoke", "--store", str(self.store)]
        self.line += ["--set", "run.tracking_seconds=0.5"]
        paths = {"PYTHONPATH": str(HERE.parents[1]), "PYTHONUNBUFFERED": "1"}
        self.process = subprocess.Popen(
            [sys.executable, HERE / "chaos_cli.py", *self.line],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
            env={**os.environ, **paths, **environment},
            start_new_session=True,
        )

    def until(self, condition):
        end = time.monotonic() + PATIENCE
        while not (found := condition()):
            assert self.process.poll() is None, self.process.communicate()
            assert time.monotonic() < end
            time.sleep(0.05)
        return found

    def named(self, name: str) -> list[psutil.Process]:
        """The processes that it has begun, by the beginning of their name."""
        children = psutil.Process(self.process.pid).children(recursive=True)
        return [child for child in children if child.name().startswith(name)]

    def held(self) -> bool:
        """Whether its training waits, and MLflow is being written."""
        log = self.store / "work" / "tracking.log"
        return log.exists() and any((self.store / "work").glob(f"pretrain-*/{HELD}"))

    def ended(self, processes: list[psutil.Process], status: int) -> str:
        """The lines on standard error, once it and all its processes are gone."""
        _, err = self.process.communicate(timeout=PATIENCE)
        assert self.process.returncode == status, err
        _, alive = psutil.wait_procs(processes, timeout=PATIENCE)
        assert alive == []
        assert "Traceback" not in err
        *_, before, resume = err.rstrip().splitlines()
        assert before.endswith("finished stages are kept. Go on with:")
        assert resume == "  dmfc " + " ".join(self.line)
        return err


@pytest.fixture
def driver(tmp_path, empty_database):
    started = []

    def start(**environment: str) -> Driver:
        started.append(Driver(tmp_path, empty_database, **environment))
        return started[-1]

    yield start
    for one in started:
        one.process.kill()
        one.process.wait()


def listening(processes: list[psutil.Process]) -> dict[str, set[str]]:
    """Addresses that processes take connections at, by their names."""
    return {
        process.name(): {
            at.laddr.ip for at in process.net_connections() if at.status == psutil.CONN_LISTEN
        }
        for process in processes
    }


def test_sigterm_in_the_middle(driver):
    one = driver()
    one.until(one.held)
    children = psutil.Process(one.process.pid).children(recursive=True)
    found = listening([psutil.Process(one.process.pid), *children])
    assert found["gcs_server"]
    assert set().union(*found.values()) <= {"127.0.0.1", "::1", "::ffff:127.0.0.1"}
    environment = one.named("gcs_server")[0].environ()
    assert environment["RAY_AUTH_MODE"] == "token"
    assert len(environment["RAY_AUTH_TOKEN"]) == 64
    assert not any(environment["RAY_AUTH_TOKEN"] in " ".join(c.cmdline()) for c in children)

    one.process.send_signal(signal.SIGTERM)
    one.ended(children, 128 + signal.SIGTERM)
    (folder,) = (one.store / "sweeps").iterdir()
    assert read_state(folder).status == "KILLED"


def test_sigterm_to_the_whole_group_while_ray_starts(driver):
    """As `timeout` and Slurm do it, which signal the processes of Ray too."""
    one = driver()
    one.until(lambda: one.named("gcs_server"))
    children = psutil.Process(one.process.pid).children(recursive=True)
    os.killpg(one.process.pid, signal.SIGTERM)
    one.ended(children, 128 + signal.SIGTERM)


def test_the_head_of_the_cluster_is_lost(driver):
    """Found out in 3 s here instead of 45; Ray itself would end the process after 60."""
    one = driver(HEAD_SECONDS="3")
    one.until(one.held)
    children = psutil.Process(one.process.pid).children(recursive=True)
    (head,) = one.named("gcs_server")
    head.kill()
    err = one.ended(children, 1)
    assert "the head of the Ray cluster at 127.0.0.1:" in err
    assert "has not answered for 3 s" in err
    (folder,) = (one.store / "sweeps").iterdir()
    assert read_state(folder).status == "KILLED"
