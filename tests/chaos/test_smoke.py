"""The smoke sweep, with its science, on two nodes of which parts are killed: `make chaos`."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path

import pandas as pd
import pytest

from dmfc.engine.context import read_attempt
from dmfc.engine.ledger import Ledger
from dmfc.engine.state import read_state
from dmfc.sweep.sweep_file import cell_config, load_sweep
from dmfc.tracking.ui import free_port
from tests.chaos.test_chaos import one_finished_run_per_cell, rows
from tests.chaos.two_nodes import TwoNodes

pytestmark = pytest.mark.chaos
ROOT = Path(__file__).resolve().parents[2]
PATIENCE = 1800.0
SWEEP = ("sweep", "table2", "--preset", "smoke", "--json")
COMMAND = [sys.executable, "-c", "from dmfc.cli.main import main; main()"]


@pytest.fixture(autouse=True)
def here(monkeypatch):
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    monkeypatch.setenv("PATH", f"{Path(sys.executable).parent}:{os.environ['PATH']}")


def kill_a_learner(ledger: Ledger, driver: subprocess.Popen) -> None:
    """SIGKILL the process of a stage of this store that trains, as its attempt names it."""

    def killed() -> bool:
        for kind in ("pretrain", "finetune"):
            for work in (ledger.store / "work").glob(f"{kind}-*"):
                with contextlib.suppress(OSError, KeyError):  # it ends, or begins just now
                    os.kill(read_attempt(work)["pid"], signal.SIGKILL)
                    return True
        return False

    until(killed, driver)


def until(condition, driver) -> None:
    end = time.monotonic() + PATIENCE
    while not condition():
        assert driver.poll() is None
        assert time.monotonic() < end
        time.sleep(0.2)


def test_a_smoke_sweep_survives_everything(tmp_path, shadow_hand_dir):
    ledger, calm = Ledger(tmp_path / "store"), Ledger(tmp_path / "calm")
    with TwoNodes() as nodes:
        settings = [f"run.ray_address={nodes.address}", "run.tracking_seconds=2", "run.retries=3"]
        options = [word for setting in settings for word in ("--set", setting)]
        call = [*COMMAND, *SWEEP, *options, "--store", ledger.store]

        def drive() -> subprocess.Popen:
            return subprocess.Popen(call, stdout=subprocess.DEVNULL)

        first = drive()
        kill_a_learner(ledger, first)
        until(lambda: list(ledger.addresses("pretrain")), first)
        nodes.kill_worker_node()
        until(lambda: list(ledger.addresses("evaluate")), first)
        first.kill()
        first.wait()
        (folder,) = (ledger.store / "sweeps").iterdir()
        assert read_state(folder).status == "KILLED"
        made = {a: ledger.record(a)["started"] for a in ledger.addresses()}
        assert drive().wait(PATIENCE) == 0
    subprocess.run([*COMMAND, *SWEEP, "--store", calm.store], check=True, stdout=subprocess.DEVNULL)
    assert set(ledger.addresses()) == set(calm.addresses())
    assert all(ledger.record(address)["started"] == at for address, at in made.items())
    pd.testing.assert_frame_equal(
        rows(ledger, folder.name).drop(columns="seconds", errors="ignore"),
        rows(calm, folder.name).drop(columns="seconds", errors="ignore"),
    )
    one_finished_run_per_cell(ledger, folder.name, epochs=1)


def test_a_ray_job_runs_on_a_cluster_of_two_nodes(tmp_path, shadow_hand_dir, monkeypatch):
    """jobs/ray_job.sh as a user calls it; two `ray start` are the cluster, with a token."""
    monkeypatch.setenv("RAY_AUTH_MODE", "token")
    monkeypatch.setenv("RAY_AUTH_TOKEN", "0123456789abcdef" * 2)
    # Ray's own choice of ports is fixed; another Ray may have them here.
    port, dashboard, client, *agents = (free_port(0) for _ in range(5))
    common = ["--num-cpus=1", "--object-store-memory=100000000", "--block"]
    head = ["--head", f"--port={port}", f"--dashboard-port={dashboard}", "--include-dashboard=true"]
    head.append(f"--ray-client-server-port={client}")
    address, jobs = f"127.0.0.1:{port}", f"http://127.0.0.1:{dashboard}"
    starts = [
        ["ray", "start", *given, f"--dashboard-agent-listen-port={agent}", *common]
        for given, agent in zip((head, [f"--address={address}"]), agents, strict=True)
    ]
    count = "import ray; ray.init(); assert sum(node['Alive'] for node in ray.nodes()) == 2"
    probe = ["ray", "job", "submit", "--address", jobs, "--", "python", "-c", count]
    nodes = [subprocess.Popen(starts[0], stdout=subprocess.DEVNULL)]
    try:
        end = time.monotonic() + PATIENCE
        while subprocess.run(probe, capture_output=True, check=False).returncode:
            assert time.monotonic() < end
            for place, start in enumerate(starts):
                if len(nodes) == place:
                    nodes.append(subprocess.Popen(start, stdout=subprocess.DEVNULL))
                elif nodes[place].poll() is not None:  # Ray gives a node 30 s to start
                    nodes[place] = subprocess.Popen(start, stdout=subprocess.DEVNULL)
            time.sleep(1)
        done = subprocess.run(
            [ROOT / "jobs" / "ray_job.sh", "table2", "--preset", "smoke"],
            env={
                **os.environ,
                "RAY_ADDRESS": jobs,
                "STORE": str(tmp_path),
            },
            capture_output=True,
            text=True,
            timeout=PATIENCE,
            check=False,
        )
    finally:
        for process in reversed(nodes):  # a node takes its leave of the head
            process.terminate()
            process.wait(120)
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-2000:]
    assert "succeeded" in done.stdout
    (folder,) = (tmp_path / "sweeps").iterdir()
    assert read_state(folder).status == "FINISHED"
    table = pd.read_parquet(folder / "trials.parquet")
    sweep = load_sweep("table2")
    configs = {cell.name: cell_config(sweep, cell, 0, "smoke", ()) for cell in sweep.cells}
    assert Counter(table["cell"]) == {
        name: config.execution.grasps_per_scene * config.scenes.test.count
        for name, config in configs.items()
    }
