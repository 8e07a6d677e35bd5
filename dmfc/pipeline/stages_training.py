"""The two stages of training: pre-training and fine-tuning.

Heavy imports are inside the functions, so that a worker loads only what its stage uses.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from dmfc.engine.context import StageContext
from dmfc.engine.record import read_record
from dmfc.errors import DmfcError
from dmfc.files.digest import file_digest, json_digest
from dmfc.pipeline.artifacts import WEIGHTS, Objects, load_grasp_sets, load_hand, load_scenes
from dmfc.pipeline.here import check_custom_backbone, check_custom_losses, require_same
from dmfc.pipeline.stages import present, whole

if TYPE_CHECKING:
    from dmfc.config.closing import ClosingConfig
    from dmfc.hand.model import HandModel
    from dmfc.objects.atlas import ObjectAtlas


def pretrain(ctx: StageContext) -> None:
    """pretrain: weights, metrics per epoch, settings, summary."""
    _train(ctx, "pretrain", None)


def finetune(ctx: StageContext) -> None:
    """finetune: as `pretrain`, from its weights or those of a trained model."""
    if "start" not in ctx.config:
        _train(ctx, "finetune", ctx.input("weights"))
        return
    folder = Path(ctx.hints["start"])
    path = folder / WEIGHTS
    require_same(f"training.finetune_from: {path}", file_digest(path), ctx.config["start"])
    _train(ctx, "finetune", folder)


def _train(ctx: StageContext, stage: Literal["pretrain", "finetune"], weights: Path | None) -> None:
    from dmfc.config.validation import ValidationConfig
    from dmfc.training.data import SceneData
    from dmfc.training.fit import fit
    from dmfc.training.settings import FitConfig

    training = ctx.config["training"]
    check_custom_losses(ctx.config.get("own_losses", {}))
    check_custom_backbone(ctx.config.get("custom_backbone", {}))
    hand, atlas = training_geometry(ctx.inputs, ctx.config.get("closing"))
    grasps = load_grasp_sets(present(ctx.input_list("grasps")))
    if not any(len(found) for found in grasps.values()):
        raise DmfcError("no training object has a grasp: raise grasps.max_checks")
    validated = "validation" in ctx.config
    if validated:
        grasps |= load_grasp_sets(whole(ctx.input_list("validation_grasps")))

    data = SceneData(
        ctx.config["scenes"],
        ctx.config["matching"],
        load_scenes(ctx.input_list("scenes")),
        grasps,
        atlas.ids,
        hand.palm_reference,
        batch_size=training.batch_size,
        workers=training.loader_workers,
        seed=training.seed,
        num_seeds=ctx.config["network"].levels[0],
        validation=load_scenes(ctx.input_list("validation_scenes")) if validated else None,
    )
    validation = ctx.config.get("validation", ValidationConfig())
    config = FitConfig(ctx.config["network"], ctx.config["losses"], training, validation)
    if "approach" in ctx.config:
        config = dataclasses.replace(config, approach=ctx.config["approach"])
    digest = data_digest(ctx.inputs)
    probe = data.probe(training.diagnostic_scenes) if training.diagnostic_scenes else None
    fit(stage, config, hand, data, atlas, ctx.out, ctx.work, weights, digest, probe, ctx.progress)


def training_geometry(
    inputs: Mapping[str, Path | list[Path]], closing: ClosingConfig | None = None
) -> tuple[HandModel, ObjectAtlas]:
    """The hand and the objects of a training stage: to train on, then to validate on.

    `closing`: how the fingers open and close (None: by default).
    """
    from dmfc.objects.atlas import ObjectAtlas

    hand, train = inputs["hand"], inputs["objects"]
    held_out = inputs.get("validation_objects", [])
    assert isinstance(hand, Path)
    assert isinstance(train, list)
    assert isinstance(held_out, list)
    objects = Objects([*present(train), *whole(held_out)])
    return load_hand(hand, closing), ObjectAtlas.of(list(objects.values()))


def data_digest(inputs: Mapping[str, Path | list[Path]]) -> str:
    """SHA-256 of the recorded digests of all files that a stage is given."""
    folders = {
        name: [given] if isinstance(given, Path) else given for name, given in inputs.items()
    }
    files = {name: [read_record(f).get("files") for f in found] for name, found in folders.items()}
    return json_digest(files)
