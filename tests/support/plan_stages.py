"""Stages of `dmfc grasps plan` on test shapes, fast; some objects fail. Run in this process.

As a program it is `dmfc` on them: python -m tests.support.plan_stages LOG SECONDS ARGUMENT ...
leaves a line per planned object in LOG, and each takes SECONDS.
"""

from __future__ import annotations

import dataclasses
import functools
import sys
import time
from pathlib import Path

import numpy as np

from dmfc.engine.kinds import StageKind
from dmfc.errors import DmfcError
from dmfc.pipeline.graph_data import ObjectRef
from dmfc.pipeline.kinds import KINDS
from dmfc.pipeline.stages import whole
from tests.support import scene_shapes

ENTRY = "tests.support.plan_stages"
PLANNING = {
    name: StageKind(name, f"{ENTRY}:{name}", KINDS[name].version, may_fail=KINDS[name].may_fail)
    for name in ("hand", "object", "grasps")
}
shapes = functools.cache(scene_shapes.shapes)
pace: dict[str, object] = {"log": None, "seconds": 0.0}


def refs(selectors):
    """Each selector is the id of a shape, or of none: then it is broken or crashes the planner."""
    return [ObjectRef(name, "digest") for name in selectors]


def hand(ctx):
    scene_shapes.paddle().save(ctx.out / "hand.npz")


def object(ctx):
    if ctx.config["object"] == "shape/broken":
        raise DmfcError("shape/broken: the mesh has no volume")
    name = ctx.config["object"]
    model = shapes().get(name, shapes()["shape/cup"])
    dataclasses.replace(model, id=name).save(ctx.out / "object.npz")


def grasps(ctx):
    whole([ctx.input("object")])
    if ctx.name == "shape/crash":
        raise ValueError("singular matrix")
    time.sleep(float(pace["seconds"]))
    model = shapes()[ctx.name]
    count = 0 if ctx.config["grasps"].max_checks == 1 else 20
    found = scene_shapes.grasps_around(model, 20)[np.arange(count)]
    found.save(ctx.out / "grasps.parquet")
    if pace["log"]:
        with Path(str(pace["log"])).open("a") as log:
            log.write(f"{ctx.name}\n")


def main(log: str, seconds: str, *arguments: str) -> None:
    """`dmfc ARGUMENTS` on the shapes, in this process alone."""
    from dmfc.cli import main as cli
    from dmfc.engine import engine, pools
    from dmfc.pipeline import selection

    module = sys.modules.get(ENTRY) or __import__(ENTRY, fromlist=["pace"])
    module.pace.update(log=log, seconds=seconds)
    KINDS.update(PLANNING)  # type: ignore[attr-defined]
    selection.list_refs = refs
    engine.RayPool = pools.LocalPool
    sys.argv = ["dmfc", *arguments]
    cli.main()


if __name__ == "__main__":
    main(*sys.argv[1:])
