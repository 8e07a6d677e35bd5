"""Two nodes with addresses of their own: one without asset cache and route; the link cut for good.

The nodes are network namespaces of this machine, joined by a virtual cable.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from pathlib import Path

import pandas as pd
import pytest

from dmfc.engine.context import read_attempt
from dmfc.engine.engine import run_stages
from dmfc.engine.ledger import Ledger
from dmfc.engine.state import read_state
from dmfc.pipeline.graph import GraphBuilder
from dmfc.pipeline.kinds import KINDS
from dmfc.pipeline.selection import list_refs
from dmfc.sweep.planner import plan_sweep
from dmfc.sweep.sweep_file import load_sweep
from tests.chaos.held import HELD
from tests.chaos.test_chaos import SWEEP, rows, until
from tests.chaos.two_networks import TwoNetworks

pytestmark = pytest.mark.chaos
HERE = Path(__file__).resolve().parent
PATIENCE = 1800.0
MORE_SECONDS = 90
"""Time that a link which is cut for good may cost a sweep."""
SMOKE = ("sweep", "table2", "--preset", "smoke", "--json")
COMMAND = [sys.executable, "-c", "from dmfc.cli.main import main; main()"]


@pytest.fixture(autouse=True)
def here(monkeypatch):
    monkeypatch.setenv("PYTHONPATH", str(HERE.parents[1]))
    monkeypatch.setenv("PATH", f"{Path(sys.executable).parent}:{os.environ['PATH']}")


def hosts(ledger: Ledger) -> set[str]:
    return {ledger.record(address)["host"] for address in ledger.addresses()}


def test_a_node_without_cache_and_route_gives_the_same_rows(tmp_path, shadow_hand_dir):
    ledger, calm = Ledger(tmp_path / "store"), Ledger(tmp_path / "calm")
    empty = tmp_path / "empty"
    with TwoNetworks({"DMFC_CACHE": str(empty)}) as nodes:
        address = f"run.ray_address={nodes.address}"
        call = [*COMMAND, *SMOKE, "--store", ledger.store, "--set", address]
        assert nodes.run(call, stdout=subprocess.DEVNULL).wait(PATIENCE) == 0
    assert hosts(ledger) == set(nodes.hosts)
    assert not empty.exists()
    plan = plan_sweep(load_sweep("table2"), GraphBuilder(list_refs), "smoke")
    plan.write(calm)
    run_stages(plan.targets, calm, plan.config, KINDS, local=True)  # without Ray
    assert set(ledger.addresses()) == set(calm.addresses())
    pd.testing.assert_frame_equal(
        rows(ledger, plan.id).drop(columns="seconds", errors="ignore"),
        rows(calm, plan.id).drop(columns="seconds", errors="ignore"),
    )


@pytest.mark.parametrize("end", ["cut", "power_off"])
def test_a_node_that_is_cut_off_for_good_costs_a_minute(tmp_path, empty_database, end):
    """Its stage is finished over there where the node lives on, and elsewhere where it does not."""
    ledger, path = Ledger(tmp_path / "store"), tmp_path / "chaos.yaml"
    path.write_text(SWEEP)
    (ledger.store / "mlflow").mkdir(parents=True)
    (ledger.store / "mlflow" / "mlflow.db").write_bytes(empty_database.read_bytes())
    hold = ledger.store / "hold-pretrain"
    hold.touch()
    with TwoNetworks() as nodes:
        call = [sys.executable, HERE / "chaos_driver.py", ledger.store, path, nodes.address]
        driver = nodes.run(call, stdout=subprocess.DEVNULL)

        def held_over_there() -> list[str]:
            found = (ledger.store / "work").glob(f"pretrain-*/{HELD}")
            works = [path.parent for path in found]
            return [w.name for w in works if read_attempt(w)["host"] == nodes.hosts[1]]

        (name,) = until(held_over_there, "a stage on the second node", driver)
        getattr(nodes, end)()
        cut = time.monotonic()
        hold.unlink()
        (described,) = (ledger.store / "sweeps").glob("*/sweep.json")
        wanted = set(json.loads(described.read_text())["stages"])
        until(lambda: wanted <= set(ledger.addresses()), "the last stage", driver)
        assert time.monotonic() - cut < MORE_SECONDS
        assert driver.wait(PATIENCE) == 0
    (folder,) = (ledger.store / "sweeps").iterdir()
    assert read_state(folder).status == "FINISHED"
    record = ledger.record(name.replace("-", "/", 1))
    assert record["host"] == nodes.hosts[1 if end == "cut" else 0]
