"""The stages: each reads its settings and inputs, calls the science, and writes one folder.

Heavy imports are inside the functions, so that a worker loads only what its stage uses.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dmfc.engine.context import StageContext
from dmfc.engine.record import failure_in, read_record
from dmfc.errors import DmfcError
from dmfc.files.atomic import write_json
from dmfc.files.digest import file_digest
from dmfc.pipeline.artifacts import (
    GRASPS,
    HAND,
    OBJECT,
    SCENE_COUNTS,
    SCENES,
    WEIGHTS,
    Objects,
    load_grasp_sets,
    load_hand,
    load_object,
    load_scenes,
)
from dmfc.pipeline.here import check_custom_test, require_same, source_here, with_packs

if TYPE_CHECKING:
    from dmfc.execution.evaluate import Evaluation
    from dmfc.hand.model import HandModel
    from dmfc.network.model import DmfcGraspNet
    from dmfc.outcome.head import HeadJudge
    from dmfc.outcome.judge import Judge


@with_packs
def make_hand(ctx: StageContext) -> None:
    """hand: `hand.npz`."""
    from dmfc.hand.build import build_hand
    from dmfc.hand.description import custom_hand_digest

    name = ctx.config["hand"].name
    require_same(f"hand '{name}'", custom_hand_digest(name), ctx.config.get("files", ""))
    build_hand(ctx.config["hand"]).save(ctx.out / HAND)


@with_packs
def prepare_object(ctx: StageContext) -> None:
    """object: `object.npz`. May fail: then a `failure.json` is there instead."""
    from dmfc.objects.prepare import prepare

    prepare(source_here(ctx), ctx.config["prepare"]).save(ctx.out / OBJECT)


@with_packs
def plan_grasps(ctx: StageContext) -> None:
    """grasps: `grasps.parquet`; an object that cannot be grasped has an empty set. May fail."""
    if "library" in ctx.config:
        _take_grasps(ctx)
        return
    from dmfc.grasps.planner import plan
    from dmfc.hand.description import load_description

    (folder,) = whole([ctx.input("object")])
    found = plan(
        load_object(folder),
        load_hand(ctx.input("hand"), ctx.config["closing"]),
        load_description(ctx.config["hand"].name),
        ctx.config["grasps"],
        ctx.config["physics"],
        ctx.config["q1"],
        ctx.progress,
    )
    found.notes["object_digest"] = _record(folder)["digest"]
    found.save(ctx.out / GRASPS)


def _take_grasps(ctx: StageContext) -> None:
    """Grasps of the library; refused if they were planned for another shape of that name."""
    import shutil

    from dmfc.grasps.grasp_set import GraspSet

    path = Path(ctx.hints["file"])
    name = ctx.config["object"]
    require_same(str(path), file_digest(path), ctx.config["library"])
    found = GraspSet.load(path)
    # A set from elsewhere does not say which mesh it was made for.
    mesh = found.notes.get("object_digest", ctx.config["digest"])
    if found.object_id != name or mesh != ctx.config["digest"]:
        raise DmfcError(
            f"the grasps of '{name}' in {path} were planned for another mesh: "
            "set grasps.source=plan to plan them again"
        )
    shutil.copyfile(path, ctx.out / GRASPS)


def _record(folder: Path) -> dict[str, Any]:
    """The settings with which a finished stage was run."""
    return read_record(folder)["config"]


def make_scenes(ctx: StageContext) -> None:
    """scenes: `scenes.parquet` and `counts.json`; with labels where grasps are given."""
    from dmfc.scenes.make import make_scene_file

    given = present if ctx.config.get("failed_objects") == "left out" else whole
    counts = make_scene_file(
        ctx.config["scenes"],
        ctx.config["set"],
        range(ctx.config["start"], ctx.config["stop"]),
        Objects(given(ctx.input_list("objects"))),
        load_grasp_sets(given(ctx.input_list("grasps"))) if "grasps" in ctx.inputs else None,
        load_hand(ctx.input("hand"), ctx.config["closing"]),
        ctx.out / SCENES,
        ctx.progress,
    )
    write_json(ctx.out / SCENE_COUNTS, counts)
    if ctx.config["start"] == 0:
        from dmfc.visualization.scenes import scene_picture

        scene = load_scenes([ctx.out])[0]
        scene_picture(scene, ctx.out / f"scene_{scene.scene:04d}.png")


@with_packs
def evaluate(ctx: StageContext) -> None:
    """evaluate: `trials.parquet` and `diversity.parquet` of a shard of test scenes."""
    from dmfc.execution.evaluate import evaluate_shard

    evaluation = evaluation_of(ctx.config, ctx.inputs, ctx.hints)
    evaluate_shard(evaluation, ctx.out, ctx.progress)


def evaluation_of(
    config: Mapping[str, Any],
    inputs: Mapping[str, Path | list[Path]],
    hints: Mapping[str, str],
) -> Evaluation:
    """What an evaluation stage executes, from its settings and the folders of its inputs."""
    from dmfc.execution.evaluate import Evaluation
    from dmfc.hand.description import load_description
    from dmfc.pipeline.stages_method import method_of

    def one(name: str) -> Path:
        folder = inputs[name]
        assert isinstance(folder, Path)
        return folder

    def several(name: str) -> list[Path]:
        folders = inputs[name]
        assert isinstance(folders, list)
        return whole(folders)

    check_custom_test(config)
    source = config["row"]
    hand = load_hand(one("hand"), config["closing"])
    network = load_model(config, inputs, hints, hand) if source == "model" else None
    scenes = load_scenes([one("scenes")])
    return Evaluation(
        source=source,
        scenes=scenes,
        objects=Objects(several("objects")),
        grasps=load_grasp_sets(several("grasps")) if source == "planner" else None,
        labels=config.get("labels"),
        network=network,
        hand=hand,
        description=load_description(config["hand"].name),
        physics=config["physics"],
        config=config["execution"],
        judge=_judge(config, inputs, hints, hand)
        if config["execution"].score == "outcome"
        else None,
        method=method_of(config, hints, scenes, hand),
    )


def load_model(
    config: Mapping[str, Any],
    inputs: Mapping[str, Path | list[Path]],
    hints: Mapping[str, str],
    hand: HandModel,
) -> DmfcGraspNet:
    """The network that proposes: of the stage `model`, or of a folder known by its weights."""
    from dmfc.network.checkpoint import load_network

    folder = Path(hints["weights"]) if "weights" in config else inputs["model"]
    assert isinstance(folder, Path)
    if "weights" in config:
        path = folder / WEIGHTS
        require_same(str(path), file_digest(path), config["weights"])
    return load_network(folder, hand)


def _judge(
    config: Mapping[str, Any],
    inputs: Mapping[str, Path | list[Path]],
    hints: Mapping[str, str],
    hand: HandModel,
) -> Judge | HeadJudge:
    """The outcome predictor of an evaluation: a folder of the user's, or a stage."""
    from dmfc.outcome.files import WEIGHTS as JUDGE
    from dmfc.outcome.head import load_judge

    folder = Path(hints["judge"]) if "judge" in config else inputs["judge"]
    assert isinstance(folder, Path)
    if "judge" in config:
        path = folder / JUDGE
        require_same(str(path), file_digest(path), config["judge"])
    judge = load_judge(folder)
    if judge.hand != hand.name:
        raise DmfcError(
            f"{folder} judges the hand '{judge.hand}', not '{hand.name}' (outcome.judge)"
        )
    return judge


def whole(folders: list[Path]) -> list[Path]:
    """The folders, if all have outputs. Raises DmfcError naming the first that failed."""
    for folder in folders:
        reason = failure_in(folder)
        if reason is not None:
            record = read_record(folder)
            raise DmfcError(f"{record['kind']} {record['name']} failed: {reason}")
    return folders


def present(folders: list[Path]) -> list[Path]:
    """The folders that have outputs. Raises DmfcError where none has."""
    found = [folder for folder in folders if failure_in(folder) is None]
    return found or whole(folders)
