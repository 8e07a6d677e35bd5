"""The stages of an outcome predictor: executed predictions, and what learns from them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from dmfc.engine.context import StageContext
from dmfc.pipeline.artifacts import SCENES, Objects, load_hand
from dmfc.pipeline.stages import evaluation_of, load_model, present

if TYPE_CHECKING:
    from pathlib import Path

    from dmfc.hand.model import HandModel


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
    if "labels" in ctx.config:
        inputs["grasps"] = present(ctx.input_list("grasps"))
    evaluation = evaluation_of(ctx.config, inputs, ctx.hints)
    roll_out(evaluation, ctx.config["rollouts"], ctx.out, ctx.progress)


def outcome(ctx: StageContext) -> None:
    """outcome: `outcome.safetensors` and `outcome.json`."""
    from dmfc.execution.rollouts import ROLLOUTS

    hand = load_hand(ctx.input("hand"), ctx.config["closing"])
    folders = present(ctx.input_list("rollouts"))
    files = [(f / ROLLOUTS, f / SCENES) for f in folders]
    learn = _features if ctx.config["outcome"].form == "features" else _head
    learn(ctx, hand, files)


def _features(ctx: StageContext, hand: HandModel, files: list[tuple[Path, Path]]) -> None:
    from dmfc.outcome.features import FeatureMaker
    from dmfc.outcome.fit import fit
    from dmfc.outcome.judge import save_judge
    from dmfc.outcome.trials import read_trials

    config = ctx.config["outcome"]
    trials = read_trials(files, FeatureMaker(hand))
    net, report = fit(trials, config, ctx.config["seed"], ctx.work, ctx.progress)
    save_judge(net, config, hand, report, ctx.out, objects_in(files))


def _head(ctx: StageContext, hand: HandModel, files: list[tuple[Path, Path]]) -> None:
    from dmfc.outcome.head import HeadJudge, fit_head

    model = load_model(ctx.config, ctx.inputs, ctx.hints, hand)
    net, calibration, report = fit_head(model, files, ctx.config["outcome"], ctx.config["seed"])
    HeadJudge(net, hand.name, *calibration).save(report, ctx.out, objects_in(files))


def objects_in(files: list[tuple[Path, Path]]) -> set[str]:
    """The objects of all scenes of pairs of rows and scenes."""
    from dmfc.scenes.scene_set import SceneSet

    scenes = SceneSet.open([scenes_file for _, scenes_file in files])
    return {name for scene in scenes for name in scene.object_ids}
