"""A node on which every stage meets an error of the machine changes no result."""

from collections import Counter
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
IN_FLIGHT = 3
"""Stages that Ray may have been given before the node was left out: two per CPU, less that one."""
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
    """The sound node does nothing before a stage has met an error on the sick one."""
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    log = tmp_path / "log"
    log.touch()
    with TwoNodes(worker_environment={"SICK": "machine"}) as nodes:
        stages = [trivial("sick", f"s{i}", i, ran_on=str(log), patience=1) for i in range(12)]
        config = load_config(None, [f"run.ray_address={nodes.address}"])
        watcher = Notes()
        outcomes = run_stages(stages, ledger, config, KINDS, watcher=watcher)
    assert {outcome.status for outcome in outcomes.values()} == {"ran"}
    assert all(ledger.failure(stage.address) is None for stage in stages)
    attempts = Counter(log.read_text().splitlines())
    assert set(attempts.values()) == {1}, "nowhere twice"
    assert {f"{stage.name} sound" for stage in stages} <= set(attempts)
    sick = len(attempts) - len(stages)
    assert 1 <= sick <= NODE_ERRORS + IN_FLIGHT
    assert len(watcher.notes) == (sick >= NODE_ERRORS)
    assert all("is left out of the rest of this run" in note for note in watcher.notes)
