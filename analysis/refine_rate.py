"""Grasps with and without refinement by gradients: yield of the checks, Q1, grasps per CPU second.

python -m analysis.refine_rate [SELECTOR ...]      (default: OBJECTS)

Every variant plans every object, in turns by object in one process, one thread. CPU time counts.
"""

from __future__ import annotations

import dataclasses
import sys
import time

import numpy as np
import torch

from dmfc.config.grasps import GraspsConfig, RefineConfig
from dmfc.config.hand import HandConfig
from dmfc.config.losses import Q1Config
from dmfc.config.objects import PrepareConfig
from dmfc.config.physics import PhysicsConfig
from dmfc.grasps.planner import plan
from dmfc.hand.build import build_hand
from dmfc.hand.description import HandDescription, load_description
from dmfc.hand.model import HandModel
from dmfc.objects.model import ObjectModel
from dmfc.objects.prepare import prepare
from dmfc.objects.sources import list_objects

OBJECTS = [
    *(f"household/{name}" for name in ("cubemedium", "banana", "mug")),
    *(f"household/{name}" for name in ("waterbottle", "stapler", "camera")),
    *(f"random/{number}" for number in (100, 200, 300, 400)),
]
PREPARED = PrepareConfig(sdf_spacing=0.002, convex_max_parts=6, convex_iterations=5)
CONFIG = GraspsConfig(per_object=10, max_checks=100, surplus=1.0, repeats=0)
VARIANTS = {
    "not refined": RefineConfig(),
    "kept, 10 steps": RefineConfig(steps=10),
    "kept, 40 steps": RefineConfig(steps=40),
    "kept, 10 steps, no Q1": RefineConfig(steps=10, q1_weight=0.0),
    "kept, 10 steps, no guidance": RefineConfig(steps=10, guidance_weight=0.0),
    "batch, 10 steps": RefineConfig(steps=10, which="batch"),
}


@dataclasses.dataclass
class Result:
    """What a variant found, over objects."""

    grasps: int = 0
    checked: int = 0
    held: int = 0
    seconds: float = 0.0
    q1: list[float] = dataclasses.field(default_factory=list)
    """Median of each object that got grasps."""

    def add(self, other: Result) -> None:
        """Count the objects of another too."""
        for name in ("grasps", "checked", "held", "seconds", "q1"):
            setattr(self, name, getattr(self, name) + getattr(other, name))

    def row(self) -> str:
        """As a row of a table."""
        share = self.held / max(1, self.checked)
        q1 = float(np.mean(self.q1)) if self.q1 else float("nan")
        counts = f"{self.grasps} | {self.held} of {self.checked} | {share:.2f}"
        return f"{counts} | {self.seconds:.2f} | {self.grasps / self.seconds:.2f} | {q1:.3f}"


def planned(
    model: ObjectModel,
    hand: HandModel,
    description: HandDescription,
    refine: RefineConfig,
    wanted: int = CONFIG.per_object,
) -> Result:
    """One variant on one object."""
    config = dataclasses.replace(CONFIG, per_object=wanted, refine=refine)
    started = time.process_time()
    found = plan(model, hand, description, config, PhysicsConfig(), Q1Config())
    seconds = time.process_time() - started
    notes = found.notes
    checked, held = int(notes["checked"]), int(notes["held"])
    q1 = [float(np.median(found.q1))] if len(found) else []
    return Result(len(found), checked, held, seconds, q1)


def main(selectors: list[str]) -> None:
    """A row per object and variant, then the totals."""
    torch.set_num_threads(1)
    hand, description = build_hand(HandConfig()), load_description("shadow")
    totals = {name: Result() for name in VARIANTS}
    print("object | variant | grasps | held | yield | CPU s | grasps/s | median Q1")
    for number, source in enumerate(list_objects(selectors or OBJECTS)):
        model = prepare(source, PREPARED)
        if number == 0:  # compiles the loops
            planned(model, hand, description, RefineConfig(steps=2), wanted=1)
        for name, refine in VARIANTS.items():
            result = planned(model, hand, description, refine)
            totals[name].add(result)
            print(f"{source.id} | {name} | {result.row()}", flush=True)
        for name, total in totals.items():
            print(f"all {number + 1} | {name} | {total.row()}", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
