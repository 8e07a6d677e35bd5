"""How long stages will take: against hand counts, bounds of scheduling, and what then happened."""

from __future__ import annotations

import io
import re

import numpy as np
import pytest
from rich.console import Console

from dmfc.engine.effort import Times, cost
from dmfc.engine.engine import run_stages
from dmfc.engine.kinds import Effort, StageKind, registry
from dmfc.engine.ledger import Ledger
from dmfc.engine.stage import Stage, closure
from dmfc.engine.watch import Progress
from dmfc.engine.worker import Outcome
from dmfc.pipeline.effort import EPOCH_SECONDS, of_training
from tests.support.trivial_graph import trivial


def sized(config, sizes):
    """Two seconds per unit of the settings, or per unit of the inputs."""
    units = sum(size["value"] for size in sizes) or config["value"]
    return Effort(units, config.get("like", ""), 2.0)


KINDS = registry(
    StageKind("add", "tests.support.trivial_stages:add", 1, effort=sized),
    StageKind("slow", "tests.support.trivial_stages:slow", 1, effort=sized, sized_by="parts"),
)


def stage(name, seconds, *parents):
    """A stage that is guessed to take so many seconds."""
    return trivial(
        "add", name, seconds / 2, {"parents": tuple(parents)} if parents else {}, of=name
    )


def test_work_waits_for_inputs_and_for_cpus(ledger):
    times = Times(ledger, KINDS)
    alike = [stage(f"s{i}", 10) for i in range(5)]
    assert cost(alike, times, 2).wall == 30
    assert cost(alike, times, 2).cpu == 50
    first = stage("first", 60)
    chain = [first, stage("second", 30, first), *alike]
    assert cost(chain, times, 2).wall == 90  # the chain on one CPU, the rest on the other
    assert cost(chain, times, 1).wall == 140
    assert cost(chain, times, 2, {first.address: 5.0}).wall == 45  # 5 + 30 + 10
    assert cost([], times, 2).wall == 0


def test_the_estimate_keeps_the_bounds_of_list_scheduling(ledger):
    """Graham (1966): between the larger and the sum of work / CPUs and the longest chain."""
    generator = np.random.default_rng(0)
    for _ in range(20):
        stages: list[Stage] = []
        longest: dict[str, float] = {}
        for place in range(30):
            count = min(len(stages), int(generator.integers(0, 3)))
            parents = [stages[i] for i in generator.permutation(len(stages))[:count]]
            seconds = float(generator.integers(1, 50))
            stages.append(stage(f"{place}", seconds, *parents))
            before = max((longest[parent.address] for parent in parents), default=0.0)
            longest[stages[-1].address] = before + seconds
        cpus = int(generator.integers(1, 5))
        found = cost(closure(stages), Times(ledger, KINDS), cpus)
        share, chain = found.cpu / cpus, max(longest.values())
        assert max(share, chain) - 1e-6 <= found.wall <= share + chain


def test_times_are_learned_per_unit_and_from_stages_alike(ledger):
    times = Times(ledger, KINDS)
    parts = (trivial("add", "a", 3), trivial("add", "b", 5))
    work = trivial("slow", "w", 1, {"parts": parts}, seconds=0)
    assert times.estimate(work).seconds == 16
    run_stages([work], ledger, _config(), KINDS, local=True)
    taken = ledger.record(work.address)["seconds"]
    times.learn(["slow", "add"])
    larger = trivial("slow", "l", 2, {"parts": (*parts, trivial("add", "c", 8))}, seconds=0)
    found = times.estimate(larger)
    assert found.measured
    assert found.seconds == pytest.approx(2 * taken)  # 16 units for 8
    other = times.estimate(trivial("slow", "o", 1, {"parts": parts}, seconds=0, like="other"))
    assert (other.measured, other.seconds) == (False, 16)
    assert cost([other_stage := trivial("add", "z", 1, like="x"), larger], times, 1).guessed == (
        "add",
    )
    assert times.estimate(other_stage).seconds == 2


def test_what_has_not_begun_counts_in_the_time_left(ledger):
    """The last training is minutes long, however short the stages were that are done."""
    out = io.StringIO()
    progress = Progress(ledger, Console(file=out, width=300), KINDS)
    short = [stage(f"s{i}", 2) for i in range(4)]
    training = trivial("slow", "long", 1, {"parts": (trivial("add", "p", 300),)})
    progress.begin([*short, training], cpus=2)
    progress.finished(short[0], Outcome("ran", seconds=2.0))
    told = re.findall(r"about (.*?) left, by a guess of (.*)", out.getvalue())
    assert told[0] == ("10 min 04 s", "add, slow")
    assert told[1][0] == "10 min 04 s"


def test_a_training_is_as_long_as_its_scenes_times_its_epochs():
    config = {"network": {}, "training": {"batch_size": 4, "finetune": {"epochs": 20}}}
    shards = [{"start": 0, "stop": 25}, {"start": 25, "stop": 40}]
    found = of_training("finetune")(config, shards)
    assert found.units * found.guess == 40 * 20 * EPOCH_SECONDS["finetune"]


def _config():
    from dmfc.config.schema import Config

    return Config()


@pytest.fixture
def ledger(tmp_path) -> Ledger:
    return Ledger(tmp_path / "store")
