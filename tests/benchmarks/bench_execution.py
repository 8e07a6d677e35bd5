"""Execution: what a trial costs, how much of it is `mj_step`, and what a second worker brings.

Not collected by the ordinary test run, which times nothing.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import get_context
from types import SimpleNamespace

import mujoco
import pandas as pd
import pytest
from mujoco.rollout import Rollout

from dmfc.config.load import load_config
from dmfc.engine.engine import run_stages
from dmfc.engine.ledger import Ledger
from dmfc.execution.evaluate import TRIALS, evaluate_shard
from dmfc.execution.trial import TrialRunner
from dmfc.pipeline.graph import GraphBuilder
from dmfc.pipeline.kinds import KINDS
from dmfc.pipeline.replay import input_folders
from dmfc.pipeline.selection import list_refs
from dmfc.pipeline.stages import evaluation_of
from tests.support.execution_shapes import runner, standing
from tests.support.grasp_shapes import planned, shape

HUNDRED = ["grasps.source=library", "scenes.test={kind: single, count: 100}"]
"""The planner's row over 100 scenes of one object of YCB in random pose, K = 4."""


SECONDS: dict[int, float] = {}
"""Workers -> time of the same trials."""


@contextmanager
def physics_clock(monkeypatch: pytest.MonkeyPatch) -> Iterator[SimpleNamespace]:
    """CPU seconds inside `mj_step`, MuJoCo's own loop over it included, steps, and all of them."""
    spent = SimpleNamespace(inside=0.0, steps=0, all=0.0)

    def timed(function, count):
        def call(*arguments, **options):
            start = time.process_time()
            result = function(*arguments, **options)
            spent.inside += time.process_time() - start
            spent.steps += count(*arguments, **options)
            return result

        return call

    with monkeypatch.context() as patch:
        patch.setattr(mujoco, "mj_step", timed(mujoco.mj_step, lambda model, data, n=1: n))
        patch.setattr(
            Rollout, "rollout", timed(Rollout.rollout, lambda *arguments, nstep, **options: nstep)
        )
        start = time.process_time()
        yield spent
        spent.all = time.process_time() - start


def note(benchmark, tell, spent: SimpleNamespace, trials: int) -> None:
    found = {
        "share of CPU time inside mj_step": round(spent.inside / spent.all, 3),
        "microseconds per step": round(1e6 * spent.inside / spent.steps, 1),
        "trials per CPU second": round(trials / spent.all, 2),
    }
    benchmark.extra_info.update(found)
    tell(f"{benchmark.group}: " + ", ".join(f"{k} {v}" for k, v in found.items()))


@pytest.fixture(scope="module")
def trials(shadow_hand_dir) -> TrialRunner:
    return runner([shape("block")], [standing("block")])


def run_all(trials: TrialRunner) -> None:
    """Every planned grasp of the block once."""
    grasps, T = planned("block"), standing("block")
    for row in range(len(grasps)):
        trials.run(T @ grasps.T_object_palm[row], grasps.joints[row], 0)


@pytest.mark.benchmark(group="trials of a block, one convex part")
def test_trials(benchmark, trials, monkeypatch, tell):
    run_all(trials)
    with physics_clock(monkeypatch) as spent:
        benchmark.pedantic(run_all, args=(trials,), rounds=1)
    note(benchmark, tell, spent, len(planned("block")))


@pytest.fixture(scope="module")
def hundred(tmp_path_factory, shadow_hand_dir) -> SimpleNamespace:
    """The evaluation's shards, and a ledger with all that they need."""
    config, ledger = load_config("quick", HUNDRED), Ledger(tmp_path_factory.mktemp("store"))
    shards = GraphBuilder(list_refs).cell(config, "planner", "planner", None).evaluations
    needed = [stage for shard in shards for stage in shard.parents]
    inputs = run_stages(needed, ledger, config, KINDS)
    assert all(outcome.ok for outcome in inputs.values())
    return SimpleNamespace(config=config, ledger=ledger, shards=shards)


@pytest.mark.benchmark(group="a shard of 8 scenes of YCB, as a worker runs it")
def test_shard(benchmark, hundred, monkeypatch, tmp_path, tell):
    """From the opening of its files to the writing of its rows."""
    stage = hundred.shards[1]
    folders = input_folders(hundred.ledger, stage.inputs)

    def shard() -> None:
        evaluate_shard(evaluation_of(stage.config, folders, stage.hints), tmp_path)

    shard()
    with physics_clock(monkeypatch) as spent:
        benchmark.pedantic(shard, rounds=1)
    note(benchmark, tell, spent, len(pd.read_parquet(tmp_path / TRIALS)))


@pytest.mark.benchmark(group="100 scenes of YCB, K = 4, all cores, Ray's start included")
def test_hundred_scenes(benchmark, hundred, tell):
    outcomes = benchmark.pedantic(
        run_stages, args=(hundred.shards, hundred.ledger, hundred.config), rounds=1
    )
    shards = [outcomes[stage.address] for stage in hundred.shards]
    assert {shard.status for shard in shards} == {"ran"}
    busy, wall = sum(shard.seconds for shard in shards), benchmark.stats.stats.mean
    benchmark.extra_info["worker_seconds"] = round(busy, 1)
    tell(
        f"100 scenes, K = 4: {wall:.0f} s (limit 150), {400 / wall:.2f} trials/s, "
        f"workers busy for {busy:.0f} s in all"
    )


@pytest.mark.benchmark(group="compiling the model of a scene")
def test_compile(benchmark, shadow_hand_dir):
    """Done once per scene; trials begin from a copied state."""
    benchmark.pedantic(lambda: runner([shape("block")], [standing("block")]), rounds=3)


def work(repeats: int) -> None:
    own = runner([shape("block")], [standing("block")])
    planned("block")
    for _ in range(repeats):
        run_all(own)


@pytest.mark.benchmark(group="12 x 6 trials on 1 and 2 workers")
@pytest.mark.parametrize("workers", [1, 2])
def test_workers(benchmark, workers, shadow_hand_dir, tell):
    """Processes, started and warm before the clock runs; ideal is half the time for two."""
    with ProcessPoolExecutor(workers, get_context("spawn")) as pool:
        list(pool.map(work, [1] * workers))
        benchmark.pedantic(
            lambda: list(pool.map(work, [12 // workers] * workers)), rounds=1, iterations=1
        )
    SECONDS[workers] = benchmark.stats.stats.mean
    if {1, 2} <= set(SECONDS):
        tell(f"from 1 to 2 workers: {SECONDS[1] / SECONDS[2]:.2f} x (limit 1.8)")
