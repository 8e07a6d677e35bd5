"""Everything is killed once, a worker, a node, the driver; then the sweep ends as if nothing were.

Here in its smallest form: two nodes on this machine, stages without science; tests/chaos does so to
the smoke sweep by `make chaos`.
"""

import json
import os
import signal
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path

import pandas as pd
import pytest

from dmfc.engine.engine import run_stages
from dmfc.engine.ledger import Ledger
from dmfc.engine.state import read_state
from dmfc.engine.system import read_lines
from dmfc.pipeline.graph import GraphBuilder
from dmfc.report.collect import collect, read_sweep
from dmfc.report.rates import concatenate
from dmfc.sweep.planner import plan_sweep
from dmfc.sweep.sweep_file import load_sweep
from tests.chaos.held import HELD
from tests.chaos.two_nodes import TwoNodes
from tests.support.fake_science import FAKES, fake_refs

pytestmark = pytest.mark.chaos
HERE = Path(__file__).resolve().parent
PATIENCE = 600.0
"""Seconds for each step: a bound for what hangs, not for a busy machine."""
SWEEP = """
name: chaos
seeds: [0, 1]
cells:
  pretrained: {model: pretrained}
  collision: {model: finetuned, set: {losses.weights.collision: 2}}
  all: {model: finetuned, set: {losses.weights.guidance: 2}}
"""


@pytest.fixture(scope="module")
def nodes():
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", str(HERE.parents[1]))
        with TwoNodes() as cluster:
            yield cluster


def until(condition, what: str, driver: subprocess.Popen):
    """What `condition` gives once it is true."""
    end = time.monotonic() + PATIENCE
    while not (found := condition()):
        assert driver.poll() is None, f"the driver ended before {what}"
        assert time.monotonic() < end, f"{what} did not come"
        time.sleep(0.05)
    return found


def rows(ledger, sweep_id):
    parts = collect(ledger, read_sweep(ledger, sweep_id))
    table = concatenate([cell.rows.assign(cell=cell.name, seed=cell.seed) for cell in parts])
    return table.sort_values(["cell", "seed", "scene", "trial"]).reset_index(drop=True)


def test_everything_is_killed_once(nodes, tmp_path, empty_database):
    path = tmp_path / "chaos.yaml"
    path.write_text(SWEEP)
    ledger = Ledger(tmp_path / "store")
    (ledger.store / "mlflow").mkdir(parents=True)
    (ledger.store / "mlflow" / "mlflow.db").write_bytes(empty_database.read_bytes())

    def drive() -> subprocess.Popen:
        call = [sys.executable, HERE / "chaos_driver.py", ledger.store, path, nodes.address]
        return subprocess.Popen(call, stdout=subprocess.DEVNULL)

    def held(kind: str) -> list[tuple[Path, dict]]:
        """Work folders of the stages of a kind that wait, and where each does."""
        found = (ledger.store / "work").glob(f"{kind}-*/{HELD}")
        return [(path.parent, json.loads(path.read_text())) for path in found]

    hold, *later = [ledger.store / f"hold-{kind}" for kind in ("pretrain", "finetune", "evaluate")]
    hold.touch()
    later[0].touch()
    first = drive()
    work, victim = until(lambda: held("pretrain"), "a stage that learns", first)[0]
    before = (work / "metrics.jsonl").read_text()
    os.kill(victim["pid"], signal.SIGKILL)
    hold.unlink()
    until(
        lambda: [w for w, at in held("finetune") if at["node"] == nodes.worker_id],
        "a stage on the second node",
        first,
    )
    later[1].touch()
    nodes.kill_worker_node()
    later[0].unlink()
    until(lambda: list(ledger.addresses("finetune")), "a fine-tuned model", first)
    first.kill()
    first.wait()
    later[1].unlink()
    folder = next((ledger.store / "sweeps").iterdir())
    assert read_state(folder).status == "KILLED"

    assert drive().wait(PATIENCE) == 0
    killed = ledger.folder(work.name.replace("-", "/", 1))
    assert (killed / "metrics.jsonl").read_text().startswith(before)
    assert len({line["by"] for line in read_lines(killed / "metrics.jsonl")}) > 1
    plan = plan_sweep(load_sweep(str(path)), GraphBuilder(fake_refs, FAKES), "smoke")
    assert folder.name == plan.id
    assert read_state(folder).status == "FINISHED"
    calm = Ledger(tmp_path / "calm")
    plan.write(calm)
    run_stages(plan.targets, calm, plan.config, kinds=FAKES, local=True)
    pd.testing.assert_frame_equal(rows(ledger, plan.id), rows(calm, plan.id))
    commits = Counter((ledger.store / "commits.log").read_text().split())
    assert set(ledger.addresses()) == set(calm.addresses())
    # A process that is killed right after a commit leaves no line of it.
    assert set(commits) <= set(calm.addresses())
    assert set(commits.values()) == {1}
    assert list((ledger.store / "stages").rglob(".partial-*")) == []
    one_finished_run_per_cell(ledger, plan.id, epochs=3)


def one_finished_run_per_cell(ledger, sweep_id, epochs):
    """One run per cell and seed, finished, and every step of every metric once."""
    from mlflow.tracking import MlflowClient

    from dmfc.tracking.store import tracking_uri
    from dmfc.tracking.writer import TAG_CELL

    client = MlflowClient(tracking_uri(ledger))
    experiment = client.get_experiment_by_name("dmfc").experiment_id
    found = client.search_runs([experiment])
    cells = read_sweep(ledger, sweep_id).cells
    names = Counter(run.data.tags[TAG_CELL] for run in found)
    assert names == Counter(["-", *(cell.run for cell in cells)])
    assert {run.info.status for run in found} == {"FINISHED"}
    for run in found:
        for name in run.data.metrics:
            steps = [m.step for m in client.get_metric_history(run.info.run_id, name)]
            assert len(steps) == len(set(steps)), (run.info.run_name, name)
        if run.data.tags["dmfc.cell"].startswith("all"):
            history = client.get_metric_history(run.info.run_id, "finetune/train/loss")
            assert sorted(m.step for m in history) == list(range(epochs))
