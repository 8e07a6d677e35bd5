"""Verified grasps per second of the planner and of the naive sampler, in turns by object.

python -m tests.benchmarks.planner_rate [SELECTOR ...]      (default: household, 48 objects)
"""

from __future__ import annotations

import sys
import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from dmfc.config.grasps import GraspsConfig
from dmfc.config.hand import HandConfig
from dmfc.config.losses import Q1Config
from dmfc.config.objects import PrepareConfig
from dmfc.config.physics import PhysicsConfig
from dmfc.grasps.planner import plan
from dmfc.hand.build import build_hand
from dmfc.hand.description import load_description
from dmfc.objects.model import ObjectModel
from dmfc.objects.prepare import prepare
from dmfc.objects.sources import list_objects
from tests.benchmarks.naive_sampler import Sampled, sample

CONFIG = GraspsConfig(per_object=20, max_checks=400, surplus=1.0, repeats=0)


@dataclass(frozen=True)
class Rates:
    """Of one object."""

    object_id: str
    grasps: int
    seconds: float
    """CPU time of the planner."""
    naive: Sampled

    @property
    def per_second(self) -> float:
        """Verified grasps of the planner."""
        return self.grasps / self.seconds


def measure(models: Iterable[ObjectModel]) -> Iterator[Rates]:
    """Plan, then sample for as much CPU time as planning took."""
    description, physics = load_description("shadow"), PhysicsConfig()
    hand = build_hand(HandConfig())
    warm = True
    for model in models:
        if warm:  # compiles the loops
            plan(
                model, hand, description, GraspsConfig(per_object=1, repeats=0), physics, Q1Config()
            )
            warm = False
        started = time.process_time()
        found = plan(model, hand, description, CONFIG, physics, Q1Config())
        seconds = time.process_time() - started
        yield Rates(
            model.id,
            len(found),
            seconds,
            sample(model, hand, description, physics, CONFIG, seconds),
        )


def main(selectors: list[str]) -> None:
    """A line per object, then the ratios of the totals."""
    done: list[Rates] = []
    sources = list_objects(selectors or ["household"])
    print(f"{'object':36} planner/s  naive/s  of these labels/s")
    for rates in measure(prepare(source, PrepareConfig(sdf_spacing=0.002)) for source in sources):
        done.append(rates)
        naive = rates.naive
        print(
            f"{rates.object_id:36} {rates.per_second:9.2f} {naive.held / naive.seconds:8.2f}"
            f" {naive.labels / naive.seconds:8.2f}   ({rates.grasps} in {rates.seconds:.1f} s)",
            flush=True,
        )
    seconds = sum(rates.seconds for rates in done)
    grasps = sum(rates.grasps for rates in done)
    sampled = sum(rates.naive.seconds for rates in done)
    held = sum(rates.naive.held for rates in done) / sampled
    labels = sum(rates.naive.labels for rates in done) / sampled
    print(f"all {len(done)}: planner {grasps / seconds:.2f}/s, naive {held:.2f}/s by its own")
    print(f"criterion, {labels:.2f}/s by the planner's: {grasps / seconds / held:.2f} and ", end="")
    print(f"{grasps / seconds / labels:.2f} times")


if __name__ == "__main__":
    main(sys.argv[1:])
