"""Every kind of stage without its science: a sweep from file to table in a second.

The rates are set by the cell: a model holds what its collision weight says, so that tables differ.
"""

import json

import pandas as pd

from dmfc.sweep.graph import ObjectRef
from dmfc.sweep.kinds import KINDS, StageKind

FAKES = {
    name: StageKind(name, f"fake_science:{name}", kind.version) for name, kind in KINDS.items()
}


def fake_refs(selectors):
    """Two objects per selector."""
    return [ObjectRef(f"{selector}/{place}") for selector in selectors for place in range(2)]


def hand(ctx):
    (ctx.out / "hand").touch()


def object(ctx):
    (ctx.out / "object").write_text(ctx.config["object"])


def grasps(ctx):
    (ctx.out / "grasps").touch()


def scenes(ctx):
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
        }
        for scene in numbers
        for trial in range(trials)
    ]
    pd.DataFrame(rows).to_parquet(ctx.out / "trials.parquet")


def _learn(ctx, stage):
    (ctx.out / "weights").touch()
    (ctx.out / "picture.png").write_bytes(b"\x89PNG")
    epochs = getattr(ctx.config["training"], stage).epochs
    with (ctx.out / "metrics.jsonl").open("w") as out:
        for epoch in range(epochs):
            line = {"stage": stage, "epoch": epoch, "split": "train", "loss": 1.0 / (epoch + 1)}
            out.write(json.dumps(line) + "\n")
