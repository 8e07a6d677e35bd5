"""A node on which every stage meets an error of the machine changes no result."""

from pathlib import Path

import pytest

from dmfc.config.load import load_config
from dmfc.engine.engine import run_stages
from dmfc.engine.kinds import StageKind, registry
from dmfc.engine.nodes import NODE_ERRORS
from tests.chaos.two_nodes import TwoNodes
from tests.support.trivial_graph import trivial

pytestmark = pytest.mark.chaos
ROOT = Path(__file__).resolve().parents[2]
KINDS = registry(StageKind("sick", "tests.support.trivial_stages:sick", 1, may_fail=True))


class Notes:
    """A watcher that keeps what it is told."""

    def __init__(self):
        self.notes = []

    def begin(self, stages, cpus): ...
    def finished(self, stage, outcome): ...
    def tick(self, running): ...
    def end(self): ...
    def note(self, text):
        self.notes.append(text)


def test_stages_go_on_elsewhere_and_the_node_is_left_out(ledger, tmp_path, monkeypatch):
    """The sound node does nothing before the sick one was left out, so that it must be."""
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    log = tmp_path / "log"
    log.touch()
    with TwoNodes(worker_environment={"SICK": "machine"}) as nodes:
        stages = [
            trivial("sick", f"s{i}", i, ran_on=str(log), patience=NODE_ERRORS) for i in range(12)
        ]
        config = load_config(None, [f"run.ray_address={nodes.address}"])
        watcher = Notes()
        outcomes = run_stages(stages, ledger, config, KINDS, watcher=watcher)
    assert {outcome.status for outcome in outcomes.values()} == {"ran"}
    assert all(ledger.failure(stage.address) is None for stage in stages)
    ran = [line.split()[1] for line in log.read_text().splitlines()]
    assert ran.count("sound") == len(stages)
    assert ran.count("sick") == NODE_ERRORS
    (note,) = watcher.notes
    assert "is left out of the rest of this run: the machine is sick" in note
