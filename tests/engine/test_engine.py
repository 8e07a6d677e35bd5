"""The engine: every stage once, failures apart, resume, two drivers."""

import dataclasses
import json
import multiprocessing
import os
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from dmfc.config.load import load_config
from dmfc.engine.context import read_progress
from dmfc.engine.engine import run_stages, unfinished
from dmfc.engine.kinds import StageKind, registry
from dmfc.engine.ledger import Ledger
from dmfc.engine.stage import Stage
from dmfc.engine.store import prunable, prune
from dmfc.engine.worker import ERROR_LOG
from dmfc.pipeline.graph import GraphBuilder
from dmfc.pipeline.kinds import KINDS
from tests.support.fake_science import FAKES, fake_refs
from tests.support.trivial_graph import TRIVIAL, trivial

ROOT = Path(__file__).resolve().parents[2]


def run(targets, ledger, config, **options):
    return run_stages(targets, ledger, config, kinds=TRIVIAL, **options)


def chain(log=""):
    """a -> b, c -> d, and e beside them."""
    a = trivial("add", "a", 1, log=log)
    b = trivial("add", "b", 10, {"from": a}, log=log)
    c = trivial("add", "c", 100, {"from": a}, log=log)
    d = trivial("add", "d", 1000, {"both": (b, c)}, log=log)
    e = trivial("add", "e", 5, log=log)
    return a, b, c, d, e


def result(ledger, stage):
    return json.loads((ledger.folder(stage.address) / "sum.json").read_text())


@pytest.mark.parametrize("local", [True, False])
def test_a_diamond_runs_each_stage_once(ledger, config, tmp_path, ray_cluster, local):
    log = tmp_path / "log"
    a, _, _, d, e = chain(str(log))
    outcomes = run([d, e], ledger, config, local=local)
    assert {outcome.status for outcome in outcomes.values()} == {"ran"}
    assert len(outcomes) == 5
    assert result(ledger, d) == 1000 + 11 + 101
    names = log.read_text().split()
    assert sorted(names) == ["a", "b", "c", "d", "e"]
    assert names.index("a") < names.index("b") < names.index("d")
    record = ledger.record(d.address)
    assert record["name"] == "d"
    assert record["inputs"]["both"] == [parent.address for parent in d.parents]
    assert record["config"]["value"] == 1000
    assert a.address in outcomes


def test_a_second_call_starts_nothing(ledger, config, tmp_path, monkeypatch):
    log = tmp_path / "log"
    d = chain(str(log))[3]
    run([d], ledger, config, local=True)
    before = log.read_text()

    def no_pool(run_config):
        raise AssertionError("a pool was made though all is there")

    monkeypatch.setattr("dmfc.engine.engine.RayPool", no_pool)
    outcomes = run([d], ledger, config)
    assert {outcome.status for outcome in outcomes.values()} == {"done"}
    assert log.read_text() == before


def test_only_what_is_missing_runs(ledger, config, tmp_path):
    log = tmp_path / "log"
    a, b, _, d, _ = chain(str(log))
    run([b], ledger, config, local=True)
    assert [stage.name for stage in unfinished([d], ledger).values()] == ["c", "d"]
    outcomes = run([d], ledger, config, local=True)
    assert outcomes[a.address].status == "done"
    assert log.read_text().split() == ["a", "b", "c", "d"]


@pytest.mark.parametrize("local", [True, False])
def test_a_failure_stops_its_dependants_alone(ledger, config, ray_cluster, local):
    bad = trivial("fail", "bad")
    after = trivial("add", "after", 1, {"from": bad})
    last = trivial("add", "last", 1, {"from": after})
    good = trivial("add", "good", 3)
    outcomes = run([last, good], ledger, config, local=local)
    assert outcomes[bad.address].status == "failed"
    assert "ValueError: broken on purpose" in outcomes[bad.address].reason
    assert "\n" not in outcomes[bad.address].reason
    assert outcomes[last.address].status == "blocked"
    assert outcomes[last.address].reason.startswith("needs bad: ValueError")
    assert outcomes[good.address].status == "ran"
    assert not ledger.finished(bad.address)
    assert not ledger.folder(bad.address).exists()
    assert "Traceback" in (ledger.work(bad.address) / ERROR_LOG).read_text()


def test_a_users_error_is_told_as_it_is(ledger, config):
    bad = trivial("fail", "bad", user_error=True)
    outcome = run([bad], ledger, config, local=True)[bad.address]
    assert outcome.reason == "the mesh 'x.stl' has no volume"


def test_a_dead_worker_is_tried_again(ledger, config, ray_cluster):
    once, never = trivial("die_once", "once", 7), trivial("die", "never")
    outcomes = run([once, never], ledger, config)
    assert outcomes[once.address].status == "ran"
    assert result(ledger, once) == 7
    assert outcomes[never.address].status == "failed"
    assert "2 attempts" in outcomes[never.address].reason


def test_two_drivers_share_the_work(ledger, config, tmp_path):
    log = tmp_path / "log"
    stages = [trivial("slow", f"s{i}", i, seconds=0.2, log=str(log)) for i in range(4)]
    total = trivial("add", "total", 0, {"parts": tuple(stages)}, log=str(log))

    def drive(index):
        return run([total], Ledger(ledger.store), config, local=True)

    with ThreadPoolExecutor(2) as drivers:
        outcomes = list(drivers.map(drive, range(2)))
    assert sorted(log.read_text().split()) == ["s0", "s1", "s2", "s3", "total"]
    assert all(outcome.ok for driver in outcomes for outcome in driver.values())
    assert result(ledger, total) == 6


def test_ctrl_c_leaves_a_store_that_goes_on(ledger, config, tmp_path):
    class Impatient:
        def begin(self, stages, cpus): ...
        def finished(self, stage, outcome):
            if stage.name == "b":
                raise KeyboardInterrupt

        def note(self, text): ...
        def tick(self, running): ...
        def end(self): ...

    log = tmp_path / "log"
    a, _, _, d, _ = chain(str(log))
    outcomes = run([d], ledger, config, local=True, watcher=Impatient())
    assert outcomes[a.address].status == "ran"
    assert outcomes[d.address].status == "interrupted"
    assert run([d], ledger, config, local=True)[d.address].status == "ran"
    assert sorted(log.read_text().split()) == ["a", "b", "c", "d"]


def test_threads_follow_the_granted_cpus(ledger, config, ray_cluster):
    stage = trivial("threads", "threads")
    run([stage], ledger, config)
    assert (ledger.folder(stage.address) / "threads.txt").read_text() == "2"
    assert ledger.record(stage.address)["cpus"] == 2


def until_waiting(ledger, stage, alive):
    """Wait until the gated stage tells that it waits."""
    while not read_progress(ledger.work(stage.address))[1]:
        assert alive()
        time.sleep(0.02)


def test_progress_is_seen_from_outside(ledger, config, tmp_path):
    stage = trivial("gated", "s", 1, gate=str(tmp_path / "gate"))
    driver = threading.Thread(target=run, args=([stage], ledger, config), kwargs={"local": True})
    driver.start()
    until_waiting(ledger, stage, driver.is_alive)
    assert read_progress(ledger.work(stage.address)) == (0.5, "waits at the gate")
    (tmp_path / "gate").touch()
    driver.join()
    assert ledger.finished(stage.address)


def test_a_killed_driver_leaves_a_store_that_goes_on(ledger, config, tmp_path):
    log, gate = tmp_path / "log", tmp_path / "gate"
    stages = [trivial("add", f"s{i}", i, log=str(log)) for i in range(2)]
    stages += [trivial("gated", f"s{i}", i, gate=str(gate), log=str(log)) for i in (2, 3)]
    total = trivial("add", "total", 0, {"parts": tuple(stages)}, log=str(log))
    driver = multiprocessing.get_context("fork").Process(
        target=run, args=([total], ledger, config), kwargs={"local": True}
    )
    driver.start()
    until_waiting(ledger, stages[2], driver.is_alive)
    os.kill(driver.pid, signal.SIGKILL)
    driver.join()
    gate.touch()
    assert [ledger.finished(stage.address) for stage in stages] == [True, True, False, False]
    outcomes = run([total], ledger, config, local=True)
    assert all(outcome.ok for outcome in outcomes.values())
    assert result(ledger, total) == 6
    assert log.read_text().split() == ["s0", "s1", "s2", "s3", "total"]
    assert list((ledger.store / "stages").rglob(".partial-*")) == []


@pytest.mark.full
def test_ray_is_started_again_when_it_dies(tmp_path):
    """Kill the raylet under a running graph, in a process that owns its Ray."""
    code = f"""
import os, signal, sys, threading, time
from pathlib import Path
from tests.support.trivial_graph import TRIVIAL, trivial
from dmfc.config.schema import Config
from dmfc.engine.engine import run_stages
from dmfc.engine.ledger import Ledger

def kill_raylet(job=[]):
    while not list(Path({str(tmp_path)!r}).glob("stages/slow/*/stage.json")):
        time.sleep(0.05)
    import ray
    os.kill(ray._private.worker._global_node.all_processes["raylet"][0].process.pid, signal.SIGKILL)

threading.Thread(target=kill_raylet, daemon=True).start()
stages = [trivial("slow", f"s{{i}}", i, seconds=1.0) for i in range(8)]
outcomes = run_stages(stages, Ledger(Path({str(tmp_path)!r})), Config(), kinds=TRIVIAL)
print(*sorted(outcome.status for outcome in outcomes.values()))
"""
    done = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        check=False,
    )
    assert done.stdout.splitlines()[-1].split() == ["ran"] * 8, done.stderr


def sweep_cell(train, test):
    """The stages of a fine-tuned cell over those objects."""
    settings = [f"objects.train=[{train}]", f"objects.test=[{test}]"]
    return GraphBuilder(fake_refs, FAKES).cell(load_config("smoke", settings), "finetuned", "c")


def test_a_training_object_that_fails_is_a_row_and_the_rest_goes_on(ledger, config):
    cell = sweep_cell("procedural/broken, procedural/fine", "ycb/mug")
    outcomes = run_stages(cell.evaluations, ledger, config, kinds=FAKES, local=True)
    failed = {a: out for a, out in outcomes.items() if not out.ok}
    assert {a.partition("/")[0] for a in failed} == {"object"}
    assert {out.reason for out in failed.values()} == {"the mesh has no volume"}
    assert all(ledger.failure(address) == "the mesh has no volume" for address in failed)
    assert ledger.finished(cell.model.address)
    shard = next(s for s in cell.model.inputs["scenes"])
    assert (ledger.folder(shard.address) / "objects").read_text() == "2"
    again = run_stages(cell.evaluations, ledger, config, kinds=FAKES, local=True)
    assert {a for a, out in again.items() if not out.ok} <= set(failed)
    doomed = prunable(ledger, [], failed=True)
    assert {entry.address for entry in prune(ledger, doomed)} == set(failed)


def test_a_test_object_that_fails_stops_the_evaluation(ledger, config):
    cell = sweep_cell("procedural/fine", "ycb/broken")
    outcomes = run_stages(cell.evaluations, ledger, config, kinds=FAKES, local=True)
    assert ledger.finished(cell.model.address)
    assert "object ycb/broken/0 failed: the mesh has no volume" in (
        outcomes[cell.evaluations[0].address].reason
    )


def may_fail(*names):
    """The trivial kinds, each of which may fail."""
    return registry(*(dataclasses.replace(TRIVIAL[name], may_fail=True) for name in names))


def test_a_stage_that_may_fail_and_crashes_is_a_row_too(ledger, config, ray_cluster):
    dead = trivial("crash", "dead")
    after = trivial("seen", "after", inputs={"from": dead})
    outcomes = run_stages([after], ledger, config, kinds=may_fail("crash", "seen"))
    assert outcomes[after.address].status == "ran"
    assert ledger.failure(dead.address).startswith("Segmentation fault: ")
    assert "2 attempts" in ledger.failure(dead.address)


def test_a_stage_that_may_fail_and_is_killed_is_not_kept(ledger, config, ray_cluster):
    killed = trivial("die", "killed")
    after = trivial("seen", "after", inputs={"from": killed})
    outcomes = run_stages([after], ledger, config, kinds=may_fail("die", "seen"))
    assert outcomes[killed.address].status == "failed"
    assert not outcomes[killed.address].kept
    assert outcomes[after.address].status == "blocked"
    assert not ledger.finished(killed.address)


@pytest.mark.parametrize("error", ["machine", "disk", "memory", "package", "caused by disk"])
@pytest.mark.parametrize("local", [True, False])
def test_an_error_of_the_machine_is_never_kept(ledger, config, ray_cluster, local, error):
    sick = trivial("sick", "s", error=error)
    after = trivial("seen", "after", inputs={"from": sick})
    outcomes = run_stages([after], ledger, config, kinds=may_fail("sick", "seen"), local=local)
    assert outcomes[sick.address].status == "failed"
    assert "the machine is sick" in outcomes[sick.address].reason
    assert not outcomes[sick.address].kept
    assert not ledger.finished(sick.address)
    assert outcomes[after.address].status == "blocked"


def test_a_time_limit_ends_a_stage_and_nothing_else(ledger, ray_cluster):
    hung = Stage("hand", "hung", 1, {"value": 1, "seconds": 600.0})
    good = trivial("slow", "good", 2, seconds=1.0)
    kinds = TRIVIAL | registry(StageKind("hand", "tests.support.trivial_stages:slow", 1))
    config = load_config(None, ["run.hand.seconds=0.6", "run.hand.retries=0"])
    outcomes = run_stages([hung, good], ledger, config, kinds=kinds)
    assert outcomes[hung.address].reason == "took longer than 0.6 s (run.hand.seconds)"
    assert outcomes[good.address].status == "ran"


def test_limits_come_from_the_settings():
    config = load_config(
        None, ["run.pretrain.gpus=0.5", "run.pretrain.memory_gb=3", "run.retries=4"]
    )
    limits = KINDS["pretrain"].limits(config)
    assert (limits.cpus, limits.gpus, limits.memory_gb, limits.retries) == (1, 0.5, 3.0, 4)
    assert KINDS["finetune"].limits(load_config(None, ["run.gpus_per_training=1"])).gpus == 1.0
