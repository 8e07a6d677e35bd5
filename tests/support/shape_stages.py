"""Hand, objects and grasps of the test shapes as stages; the scenes made of them are real."""

from __future__ import annotations

import functools
import os
import signal
import time
from pathlib import Path

from dmfc.engine.kinds import StageKind
from dmfc.pipeline.graph_data import ObjectRef
from dmfc.pipeline.kinds import KINDS
from dmfc.pipeline.stages import make_scenes
from tests.support import scene_shapes
from tests.support.small_files import small_files

SHAPES = {
    name: StageKind(name, f"tests.support.shape_stages:{name}", KINDS[name].version)
    for name in ("hand", "object", "grasps")
}
TROUBLED = {**KINDS, **SHAPES} | {
    "scenes": StageKind("scenes", "tests.support.shape_stages:scenes", KINDS["scenes"].version)
}
"""Shards that meet what the environment TROUBLE says, as 'which shard:what'."""


shapes = functools.cache(scene_shapes.shapes)


def shape_refs(selectors):
    """The shapes, whatever is selected."""
    names = sorted(shapes())
    return [ObjectRef(name, "digest") for name in names]


def hand(ctx):
    scene_shapes.paddle().save(ctx.out / "hand.npz")


def object(ctx):
    shapes()[ctx.config["object"]].save(ctx.out / "object.npz")


def grasps(ctx):
    model = shapes()[ctx.name]
    scene_shapes.grasps_around(model, 80).save(ctx.out / "grasps.parquet")


def scenes(ctx):
    """A shard; the disk is full, or the process is killed, when it is to be written."""
    trouble = os.environ.get("TROUBLE", "")
    which, _, what = trouble.partition(":")
    if which == ctx.name.rpartition(":")[2]:
        if what == "full disk":
            with small_files(1000):
                make_scenes(ctx)
        elif what == "killed":
            Path(os.environ["TROUBLE_SIGN"]).touch()
            (ctx.out / "scenes.parquet").write_bytes(b"half a shard")
            time.sleep(0.05)
            os.kill(os.getpid(), signal.SIGKILL)
    make_scenes(ctx)
