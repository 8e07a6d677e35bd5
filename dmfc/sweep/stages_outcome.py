"""The stages of an outcome predictor: executed predictions, and what learns from them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from dmfc.sweep.context import StageContext
from dmfc.sweep.stages import HAND, SCENES, Objects, evaluation_of, present

if TYPE_CHECKING:
    from pathlib import Path


def rollouts(ctx: StageContext) -> None:
    """rollouts: `scenes.parquet`, and `rollouts.parquet` with the trials in them."""
    from dmfc.execution.rollouts import roll_out
    from dmfc.hand.model import HandModel
    from dmfc.scenes.make import make_scene_file

    objects = present(ctx.input_list("objects"))
    numbers = range(ctx.config["start"], ctx.config["stop"])
    make_scene_file(
        ctx.config["scenes"],
        ctx.config["set"],
        numbers,
        Objects(objects),
        None,
        HandModel.load(ctx.input("hand") / HAND),
        ctx.out / SCENES,
    )
    inputs: dict[str, Path | list[Path]] = {**ctx.inputs, "scenes": ctx.out, "objects": objects}
    evaluation = evaluation_of(ctx.config, inputs, ctx.hints)
    roll_out(evaluation, ctx.config["rollouts"], ctx.out, ctx.progress)
