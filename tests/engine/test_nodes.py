"""Nodes of a cluster: an error of one is not of the stage; what no node can give is said."""

import json
import multiprocessing
import socket
import time

import pytest

from dmfc.config.load import load_config
from dmfc.engine.engine import run_stages
from dmfc.engine.nodes import NODE_ERRORS, Node, NodeErrors, Silence, unmet
from dmfc.engine.worker import Job, execute
from tests.support.trivial_graph import TRIVIAL, trivial


def job(**asked) -> Job:
    wanted = {"cpus": 1, "gpus": 0.0, **asked}
    return Job("store", "pretrain", "p", "k", 1, "entry", {}, {}, commit="", **wanted)


def node(name: str, **given) -> Node:
    there = {"cpus": 4.0, "gpus": 1.0, "memory_gb": 16.0, "port": 1, **given}
    return Node(name, f"host-{name}", "10.0.0.1", **there)


@pytest.mark.parametrize(
    ("asked", "setting"),
    [
        ({"cpus": 5}, "5 CPUs (run.pretrain.cpus)"),
        ({"gpus": 2.0}, "2 GPUs (run.pretrain.gpus, run.gpus_per_training)"),
        ({"memory_gb": 17.0}, "17 GB of memory (run.pretrain.memory_gb)"),
        # Each node gives a part of it, none all.
        ({"cpus": 4, "memory_gb": 8.0, "gpus": 1.5}, "1.5 GPUs"),
    ],
)
def test_what_no_single_node_can_give_names_the_setting(asked, setting):
    nodes = [node("a"), node("b", cpus=2.0, gpus=4.0, memory_gb=4.0)]
    nodes[1:] = nodes[1:] if asked.get("gpus") != 2.0 else []
    told = unmet(job(**asked), nodes)
    assert setting in told
    assert "4 CPUs, 1 GPUs, 16.0 GB" in told


def test_what_one_node_can_give_is_met():
    assert unmet(job(cpus=4, gpus=0.5, memory_gb=16.0), [node("b", cpus=1.0), node("a")]) == ""
    assert unmet(job(avoid=("a",)), [node("a"), node("b")]) == ""
    assert "without those that have failed" in unmet(job(avoid=("a",)), [node("a")])
    assert "none" in unmet(job(), [])


def test_a_node_is_left_out_after_errors_in_a_row_and_never_the_last():
    nodes, errors = [node("a"), node("b")], NodeErrors()
    for stage in range(NODE_ERRORS - 1):
        errors.add(f"s{stage}", "a")
    errors.add("s0", "a")  # the same stage again says nothing new
    assert not errors.leave_out("a", nodes)
    errors.succeeded("a")
    errors.add("last", "a")
    assert not errors.leave_out("a", nodes)
    for stage in range(NODE_ERRORS):
        errors.add(f"t{stage}", "a")
    assert errors.leave_out("a", nodes)
    assert errors.left_out == {"a"}
    assert not errors.leave_out("a", nodes), "that is told once"
    for stage in range(NODE_ERRORS):
        errors.add(f"u{stage}", "b")
    assert not errors.leave_out("b", nodes), "somebody must do the work"


def test_a_stage_that_fails_everywhere_is_no_nodes_fault():
    nodes, errors = [node("a"), node("b")], NodeErrors()
    for stage in range(NODE_ERRORS):
        errors.add(f"s{stage}", "a")
        errors.acquit(f"s{stage}")
    assert not errors.leave_out("a", nodes)


def test_a_node_that_listens_answers_and_one_that_does_not_is_cut_off(monkeypatch):
    monkeypatch.setattr("dmfc.engine.nodes.SILENT_SECONDS", 0.0)
    with socket.create_server(("127.0.0.1", 0)) as server, socket.socket() as closed:
        closed.bind(("127.0.0.1", 0))  # bound, and nobody listens: refused
        there = Node("a", "a", "127.0.0.1", server.getsockname()[1], 1, 0, 1)
        gone = Node("b", "b", "127.0.0.1", closed.getsockname()[1], 1, 0, 1)
        assert Silence().cut_off([there, gone]) == [gone]


def test_a_node_that_answers_again_is_no_longer_cut_off(monkeypatch):
    monkeypatch.setattr("dmfc.engine.nodes.SILENT_SECONDS", 0.0)
    monkeypatch.setattr("dmfc.engine.nodes.PROBE_SECONDS", 0.0)
    answers = [False, True]
    silence, one = Silence(lambda node: answers.pop(0)), node("a")
    assert [silence.cut_off([one]), silence.cut_off([one])] == [[one], []]


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


@pytest.mark.parametrize(
    ("setting", "part"),
    [
        ("run.hand.gpus=1", "1 GPUs (run.hand.gpus"),
        ("run.hand.memory_gb=9999", "9999 GB of memory"),
    ],
)
def test_a_request_that_no_node_meets_ends_and_blocks_nothing_else(
    ledger, ray_cluster, setting, part
):
    kinds = TRIVIAL | {"hand": TRIVIAL["add"]}
    kinds["hand"] = type(kinds["hand"])("hand", kinds["hand"].entry, 1)
    greedy, good = trivial("hand", "greedy"), trivial("add", "good")
    outcomes = run_stages([greedy, good], ledger, load_config(None, [setting]), kinds=kinds)
    assert outcomes[greedy.address].status == "failed"
    assert part in outcomes[greedy.address].reason
    assert "run.scales_up" in outcomes[greedy.address].reason
    assert outcomes[good.address].status == "ran"


def test_a_cluster_that_scales_up_is_waited_for_and_that_is_said(ledger, ray_cluster):
    """The node never comes: the watcher ends the wait once it is told."""

    class Impatient(Notes):
        def tick(self, running):
            if self.notes:
                raise KeyboardInterrupt

    kinds = TRIVIAL | {"hand": type(TRIVIAL["add"])("hand", TRIVIAL["add"].entry, 1)}
    config = load_config(None, ["run.hand.gpus=1", "run.scales_up=true"])
    stage, watcher = trivial("hand", "greedy"), Impatient()
    outcomes = run_stages([stage], ledger, config, kinds=kinds, watcher=watcher)
    assert outcomes[stage.address].status == "interrupted"
    (note,) = watcher.notes
    assert note.startswith("hand greedy waits: no node can give")


@pytest.mark.parametrize("local", [True, False])
def test_who_holds_a_lock_is_said(ledger, config, ray_cluster, tmp_path, local):
    """Another process is at work on the stage; it goes on once this driver has said so."""
    gate = tmp_path / "gate"
    stage = trivial("gated", "g", gate=str(gate))

    class Opens(Notes):
        def note(self, text):
            super().note(text)
            gate.touch()

    other = multiprocessing.get_context("fork").Process(
        target=run_stages, args=([stage], ledger, config, TRIVIAL), kwargs={"local": True}
    )
    other.start()
    while not (ledger.work(stage.address) / "progress.json").exists():
        assert other.is_alive()
        time.sleep(0.02)
    watcher = Opens()
    outcomes = run_stages([stage], ledger, config, TRIVIAL, watcher=watcher, local=local)
    other.join()
    assert outcomes[stage.address].status == "done"
    (note,) = watcher.notes
    assert f"process {other.pid} on " in note
    assert "is at work on it" in note


def test_a_machine_that_sees_another_store_does_nothing_there(tmp_path):
    given = Job(
        str(tmp_path / "store"), "add", "a", "k", 1, "tests.support.trivial_stages:add",
        {"value": 1}, {}, 1, 0.0, "", sign="locks/driver-x.sign",
    )  # fmt: skip
    outcome = execute(given)
    assert outcome.status == "machine"
    assert "not the driver's" in outcome.reason
    assert not (tmp_path / "store" / "stages").exists()
    sign = tmp_path / "store" / given.sign
    sign.parent.mkdir(parents=True, exist_ok=True)
    sign.touch()
    assert execute(given).status == "ran"
    assert json.loads((tmp_path / "store/stages/add/k/sum.json").read_text()) == 1
