"""The stages: each reads its settings and inputs, calls the science, and writes one folder.

Heavy imports are inside the functions, so that a worker loads only what its stage uses.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from dmfc.errors import DmfcError
from dmfc.sweep.context import StageContext, write_json

if TYPE_CHECKING:
    from dmfc.execution.evaluate import Evaluation
    from dmfc.grasps.grasp_set import GraspSet
    from dmfc.hand.model import HandModel
    from dmfc.objects.model import ObjectModel

HAND, OBJECT, GRASPS, SCENES = "hand.npz", "object.npz", "grasps.parquet", "scenes.parquet"
TRIALS = "trials.parquet"


def make_hand(ctx: StageContext) -> None:
    """hand: `hand.npz`."""
    from dmfc.hand.build import build_hand

    build_hand(ctx.config["hand"]).save(ctx.out / HAND)


def prepare_object(ctx: StageContext) -> None:
    """object: `object.npz`."""
    from dmfc.objects.prepare import prepare_to

    prepare_to(ctx.hints["selector"], ctx.config["prepare"], ctx.out / OBJECT)


def plan_grasps(ctx: StageContext) -> None:
    """grasps: `grasps.parquet`; an object that cannot be grasped has an empty set."""
    if "library" in ctx.config:
        _take_grasps(ctx)
        return
    from dmfc.grasps.planner import plan
    from dmfc.hand.description import load_description
    from dmfc.objects.model import ObjectModel

    found = plan(
        ObjectModel.load(ctx.input("object") / OBJECT),
        _hand(ctx),
        load_description(ctx.config["hand"].name),
        ctx.config["grasps"],
        ctx.config["physics"],
        ctx.config["q1"],
        ctx.progress,
    )
    found.notes["object_digest"] = _record(ctx.input("object"))["digest"]
    found.save(ctx.out / GRASPS)


def _take_grasps(ctx: StageContext) -> None:
    """Grasps of the library; refused if they were planned for another shape of that name."""
    import shutil

    from dmfc.grasps.grasp_set import GraspSet
    from dmfc.grasps.library import file_digest

    path = Path(ctx.hints["file"])
    found = GraspSet.load(path)
    name = ctx.config["object"]
    if file_digest(path) != ctx.config["library"]:
        raise DmfcError(f"{path} has changed since the sweep began: run it again")
    if found.object_id != name or found.notes.get("object_digest") != ctx.config["digest"]:
        raise DmfcError(
            f"the library's grasps of '{name}' were planned for another mesh: "
            "set grasps.source=plan to plan them anew"
        )
    shutil.copyfile(path, ctx.out / GRASPS)


def _record(folder: Path) -> dict[str, Any]:
    """The settings with which a finished stage was run."""
    import json

    return json.loads((folder / "stage.json").read_text())["config"]


def make_scenes(ctx: StageContext) -> None:
    """scenes: `scenes.parquet` and `counts.json`."""
    from dmfc.scenes.make import make_scene_file

    counts = make_scene_file(
        ctx.config["scenes"],
        ctx.config["set"],
        range(ctx.config["start"], ctx.config["stop"]),
        _Objects(ctx.input_list("objects")),
        _grasp_sets(ctx.input_list("grasps")),
        _hand(ctx),
        ctx.out / SCENES,
        ctx.progress,
    )
    write_json(ctx.out / "counts.json", counts)
    if ctx.config["start"] == 0:
        from dmfc.scenes.picture import scene_picture
        from dmfc.scenes.scene_set import SceneSet

        scene = SceneSet.open([ctx.out / SCENES])[0]
        scene_picture(scene, ctx.out / f"scene_{scene.scene:04d}.png")


def pretrain(ctx: StageContext) -> None:
    """pretrain: weights, metrics per epoch, settings, summary."""
    _train(ctx, "pretrain", None)


def finetune(ctx: StageContext) -> None:
    """finetune: as `pretrain`, from its weights."""
    _train(ctx, "finetune", ctx.input("weights"))


def evaluate(ctx: StageContext) -> None:
    """evaluate: `trials.parquet`, a row per trial of a shard of test scenes."""
    from dmfc.execution.evaluate import evaluate_shard

    evaluate_shard(evaluation_of(ctx.config, ctx.inputs), ctx.out / TRIALS, ctx.progress)


def evaluation_of(config: Mapping[str, Any], inputs: Mapping[str, Path | list[Path]]) -> Evaluation:
    """What an evaluation stage executes, from its settings and the folders of its inputs."""
    from dmfc.execution.evaluate import Evaluation
    from dmfc.hand.description import load_description
    from dmfc.hand.model import HandModel
    from dmfc.scenes.scene_set import SceneSet
    from dmfc.training.weights import load_network

    def one(name: str) -> Path:
        folder = inputs[name]
        assert isinstance(folder, Path)
        return folder

    def several(name: str) -> list[Path]:
        folders = inputs[name]
        assert isinstance(folders, list)
        return folders

    hand, row = HandModel.load(one("hand") / HAND), config["row"]
    return Evaluation(
        row=row,
        scenes=SceneSet.open([one("scenes") / SCENES]),
        objects=_Objects(several("objects")),
        grasps=_grasp_sets(several("grasps")) if row == "planner" else None,
        network=load_network(one("model"), hand) if row == "model" else None,
        hand=hand,
        description=load_description(config["hand"].name),
        physics=config["physics"],
        config=config["execution"],
    )


class _Objects(Mapping[str, "ObjectModel"]):
    """Prepared objects by id, each loaded when it is asked for.

    The ids are read from the stages' records, so a scene of one object loads one object.
    """

    def __init__(self, folders: list[Path]) -> None:
        self._folders = {_record(folder)["object"]: folder for folder in folders}
        self._loaded: dict[str, ObjectModel] = {}

    def __getitem__(self, object_id: str) -> ObjectModel:
        if object_id not in self._loaded:
            from dmfc.objects.model import ObjectModel

            self._loaded[object_id] = ObjectModel.load(self._folders[object_id] / OBJECT)
        return self._loaded[object_id]

    def __iter__(self) -> Iterator[str]:
        return iter(self._folders)

    def __len__(self) -> int:
        return len(self._folders)


def _hand(ctx: StageContext) -> HandModel:
    from dmfc.hand.model import HandModel

    return HandModel.load(ctx.input("hand") / HAND)


def _grasp_sets(folders: list[Path]) -> dict[str, GraspSet]:
    from dmfc.grasps.grasp_set import GraspSet

    sets = [GraspSet.load(folder / GRASPS) for folder in folders]
    return {found.object_id: found for found in sets}


def _train(ctx: StageContext, stage: Literal["pretrain", "finetune"], weights: Path | None) -> None:
    from dmfc.losses.atlas import ObjectAtlas
    from dmfc.scenes.dataset import SceneData
    from dmfc.scenes.scene_set import SceneSet
    from dmfc.training.fit import FitConfig, fit

    training = ctx.config["training"]
    hand, objects = _hand(ctx), _Objects(ctx.input_list("objects"))
    grasps = _grasp_sets(ctx.input_list("grasps"))
    if not any(len(found) for found in grasps.values()):
        raise DmfcError("no training object has a grasp: raise grasps.max_checks")
    data = SceneData(
        ctx.config["scenes"],
        ctx.config["matching"],
        SceneSet.open([folder / SCENES for folder in ctx.input_list("scenes")]),
        grasps,
        list(objects),
        hand.palm_reference,
        batch_size=training.batch_size,
        workers=training.loader_workers,
        seed=training.seed,
        seeds=ctx.config["network"].levels[0],
    )
    config = FitConfig(ctx.config["network"], ctx.config["losses"], training)
    atlas = ObjectAtlas.of(list(objects.values()))
    fit(stage, config, hand, data, atlas, ctx.out, ctx.work, weights, ctx.progress)
