"""Every kind of stage without its science: a sweep from file to table in a second.

Validation measures how far the collision weight is from 1, in decades: a search has an optimum.
"""

import json
import math
import time

import pandas as pd

from dmfc.engine.kinds import StageKind
from dmfc.errors import DmfcError
from dmfc.experiment.evaluation import CHECKS
from dmfc.pipeline.graph_data import ObjectRef
from dmfc.pipeline.kinds import KINDS
from dmfc.pipeline.stages import present, whole

FAKES = {
    name: StageKind(
        name,
        f"tests.support.fake_science:{name}",
        kind.version,
        may_fail=kind.may_fail,
        identity=kind.identity,
    )
    for name, kind in KINDS.items()
}


def fake_refs(selectors):
    """Two objects per selector."""
    return [ObjectRef(f"{selector}/{place}") for selector in selectors for place in range(2)]


def hand(ctx):
    (ctx.out / "hand").write_text("five fingers")


def object(ctx):
    if "broken" in ctx.config["object"]:
        raise DmfcError("the mesh has no volume")
    (ctx.out / "object").write_text(ctx.config["object"])


def grasps(ctx):
    (ctx.out / "grasps").write_text("from above")


def scenes(ctx):
    given = present if ctx.config.get("failed_objects") == "left out" else whole
    (ctx.out / "objects").write_text(str(len(given(ctx.input_list("objects")))))
    numbers = list(range(ctx.config["start"], ctx.config["stop"]))
    (ctx.out / "scenes.json").write_text(json.dumps(numbers))


def pretrain(ctx):
    _learn(ctx, "pretrain")


def finetune(ctx):
    assert (ctx.input("weights") / "weights").is_file()
    if ctx.config["losses"].weights.guidance == 13:
        raise ValueError("the loss is not finite")
    _learn(ctx, "finetune")


def evaluate(ctx):
    numbers = json.loads((ctx.input("scenes") / "scenes.json").read_text())
    trials = ctx.config["execution"].grasps_per_scene
    rows = [
        {
            "scene": scene,
            "trial": trial,
            "object": f"ycb/{scene % 2}",
            "planned": trial != 0 or ctx.config["row"] == "planner",
            "held": trial > 1 and ctx.config["row"] != "random",
            "reason": "" if trial > 1 else "slipped",
            **dict.fromkeys(CHECKS, 0.001),
        }
        for scene in numbers
        for trial in range(trials)
    ]
    pd.DataFrame(rows).to_parquet(ctx.out / "trials.parquet")
    spread = pd.DataFrame({"scene": numbers, "proposed": 512, "executed_position": 0.1})
    spread.to_parquet(ctx.out / "diversity.parquet")


def _learn(ctx, stage):
    (ctx.out / "weights").write_text("of layers")
    (ctx.out / "picture.png").write_bytes(b"\x89PNG")
    epochs = getattr(ctx.config["training"], stage).epochs
    with (ctx.out / "metrics.jsonl").open("w") as out:
        for epoch in range(epochs):
            line = {"stage": stage, "epoch": epoch, "split": "train", "loss": 1.0 / (epoch + 1)}
            line["time"] = round(time.time(), 3)
            out.write(json.dumps(line) + "\n")
        if "validation" in ctx.config:
            off = abs(math.log10(ctx.config["losses"].weights.collision or 1e-9))
            measured = {"coverage": 1.0 - 0.1 * off, "penetration_mm": 10 * off}
            out.write(json.dumps({**line, "split": "val", **measured}) + "\n")
