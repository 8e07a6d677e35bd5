"""The stages of an outcome predictor: executed predictions, and what learns from them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from dmfc.engine.context import StageContext
from dmfc.pipeline.artifacts import SCENES, Objects, load_hand
from dmfc.pipeline.stages import evaluation_of, present

if TYPE_CHECKING:
    from pathlib import Path


def rollouts(ctx: StageContext) -> None:
    """rollouts: `scenes.parquet`, `rollouts.parquet` with the trials in them. May fail."""
    from dmfc.execution.rollouts import roll_out
    from dmfc.scenes.make import make_scene_file

    objects = present(ctx.input_list("objects"))
    numbers = range(ctx.config["start"], ctx.config["stop"])
    make_scene_file(
        ctx.config["scenes"],
        ctx.config["set"],
        numbers,
        Objects(objects),
        None,
        load_hand(ctx.input("hand"), ctx.config["closing"]),
        ctx.out / SCENES,
    )
    inputs: dict[str, Path | list[Path]] = {**ctx.inputs, "scenes": ctx.out, "objects": objects}
    evaluation = evaluation_of(ctx.config, inputs, ctx.hints)
    roll_out(evaluation, ctx.config["rollouts"], ctx.out, ctx.progress)


def outcome(ctx: StageContext) -> None:
    """outcome: `outcome.safetensors` and `outcome.json`."""
    from dmfc.execution.rollouts import ROLLOUTS
    from dmfc.outcome.features import FeatureMaker
    from dmfc.outcome.fit import fit
    from dmfc.outcome.judge import save_judge
    from dmfc.outcome.trials import read_trials

    hand = load_hand(ctx.input("hand"), ctx.config["closing"])
    folders = present(ctx.input_list("rollouts"))
    trials = read_trials([(f / ROLLOUTS, f / SCENES) for f in folders], FeatureMaker(hand))
    config = ctx.config["outcome"]
    net, report = fit(trials, config, ctx.config["seed"], ctx.work, ctx.progress)
    save_judge(net, config, hand, report, ctx.out)
