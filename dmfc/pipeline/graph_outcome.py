"""The stages of an outcome predictor: executed predictions, and what learns from them."""

from __future__ import annotations

import dataclasses
import hashlib
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dmfc.config.custom_function import custom_class, is_custom
from dmfc.config.protocol import executed
from dmfc.config.scenes import SceneSetConfig
from dmfc.config.schema import Config
from dmfc.engine.stage import Stage, without
from dmfc.errors import DmfcError
from dmfc.files.digest import file_digest
from dmfc.network.model_files import WEIGHTS
from dmfc.outcome.files import FEATURES_VERSION, refuse_learned
from dmfc.outcome.files import WEIGHTS as JUDGE
from dmfc.pipeline.graph_data import Inputs, of_every_scene

if TYPE_CHECKING:
    from dmfc.pipeline.graph import GraphBuilder
    from dmfc.pipeline.graph_data import Inputs

SELECTION = (
    "protocol",
    "score",
    "confidence_unit",
    "cloud_margin",
    "changes",
    "grasps_per_scene",
    "min_confidence",
    "most_confident",
    "cloud_check",
    "seed",
    "random_offset",
)
"""Settings of execution that say which grasps of a scene are executed, not how."""


def proposer_of(config: Config, model: Stage | None, checkpoint: Path | None) -> Stage | Path:
    """The model whose predictions are executed: the cell's own, or that of `outcome.proposer`."""
    if config.outcome.proposer:
        from dmfc.prediction.models import model_folder

        return model_folder(config.outcome.proposer)
    own = model or checkpoint
    if own is None:
        raise DmfcError("rows without a model need outcome.proposer: the model of the predictor")
    return own


def rollouts(builder: GraphBuilder, config: Config, proposer: Stage | Path) -> tuple[Stage, ...]:
    """Executed predictions: a stage per object alone, and shards of scenes of several objects.

    Raises DmfcError where a test object is among them.
    """
    objects = builder.selected_objects(config, config.outcome.objects or config.objects.train)
    tested = {stage.name for stage in builder.objects(config, "test")}
    shared = tested & {stage.name for stage in objects}
    if shared:
        raise DmfcError(
            f"'{min(shared)}' is in outcome.objects and in objects.test: a predictor must not "
            "have seen what it is tested on"
        )
    chosen = config.outcome.rollouts
    counts = "per_object", "clutter", "shards", "min_objects", "max_objects"
    alone = dataclasses.replace(without(chosen, *counts[1:]), per_object=1)
    made = []
    if chosen.per_object:
        scenes = SceneSetConfig(kind="single", seed=chosen.seed, sensor=chosen.sensor)
        for obj in objects:
            start = _first_scene(obj.name)
            numbers = range(start, start + chosen.per_object)
            given = _shard(builder, config, proposer, alone, scenes, numbers, (obj,))
            made.append(builder.stage("rollouts", obj.name, *given))
    for shard in range(chosen.shards if chosen.clutter else 0):
        scenes = SceneSetConfig(
            kind="multi",
            seed=chosen.seed,
            sensor=chosen.sensor,
            min_objects=chosen.min_objects,
            max_objects=chosen.max_objects,
        )
        numbers = range(shard * chosen.clutter, (shard + 1) * chosen.clutter)
        given = _shard(builder, config, proposer, alone, scenes, numbers, objects)
        made.append(builder.stage("rollouts", f"clutter:{shard}", *given))
    return tuple(made)


def _first_scene(name: str) -> int:
    """Scenes of different objects have different numbers, and so their own poses."""
    return 1000 * (int(hashlib.sha256(name.encode()).hexdigest()[:8], 16) % 1_000_000)


def _shard(
    builder: GraphBuilder,
    config: Config,
    proposer: Stage | Path,
    chosen: Any,
    scenes: SceneSetConfig,
    numbers: range,
    objects: tuple[Stage, ...],
) -> tuple[dict[str, Any], Inputs, dict[str, str]]:
    """Settings, inputs and hints of a shard."""
    under = executed(config)
    labels = chosen.source == "labels"
    settings: dict[str, Any] = {
        "row": "planner" if labels else "model",
        "hand": under.hand,
        "closing": under.closing,
        "execution": without(under.execution, *SELECTION),
        "physics": under.physics,
        "rollouts": chosen,
        "set": without(scenes, "count"),
        "scenes": without(config.scenes, "train", "test", "shard_size", "augmentation"),
        "start": numbers.start,
        "stop": numbers.stop,
    }
    if is_custom(under.execution.test):
        settings["custom_test"] = custom_class(under.execution.test, "execution.test").digest
    inputs: Inputs = {"hand": builder.hand(config), "objects": objects}
    if labels:
        settings["labels"] = of_every_scene(config)
        grasps = tuple(builder.grasps_of(config, obj) for obj in objects)
        return settings, {**inputs, "grasps": grasps}, {}
    if isinstance(proposer, Path):
        settings["weights"] = file_digest(proposer / WEIGHTS)
        return settings, inputs, {"weights": str(proposer)}
    return settings, {**inputs, "model": proposer}, {}


def judge(
    builder: GraphBuilder, config: Config, model: Stage | None, checkpoint: Path | None
) -> tuple[dict[str, Any], Inputs, dict[str, str]]:
    """Settings, inputs and hints that an evaluation ranked by an outcome predictor has besides."""
    folder = _given_judge(config, checkpoint)
    if folder is not None:
        tested = [stage.name for stage in builder.objects(config, "test")]
        refuse_learned(folder, tested, "objects.test")
        return {"judge": file_digest(folder / JUDGE)}, {}, {"judge": str(folder)}
    return {}, {"judge": outcome(builder, config, proposer_of(config, model, checkpoint))}, {}


def outcome(builder: GraphBuilder, config: Config, proposer: Stage | Path) -> Stage:
    """The predictor that learns from the executed predictions of a model."""
    settings = {
        "outcome": without(config.outcome, "objects", "proposer", "judge", "rollouts"),
        "features": FEATURES_VERSION,
        "closing": executed(config).closing,
        "seed": config.training.seed,
    }
    trials = rollouts(builder, config, proposer)
    inputs: Inputs = {"hand": builder.hand(config), "rollouts": trials}
    hints: dict[str, str] = {}
    if config.outcome.form == "head":
        if isinstance(proposer, Path):
            settings["weights"], hints = file_digest(proposer / WEIGHTS), {"weights": str(proposer)}
        elif is_custom(config.network.backbone):
            raise DmfcError(
                "outcome.form=head keeps no copy of a backbone of your own (network.backbone): "
                "take outcome.form=features"
            )
        else:
            inputs = {**inputs, "model": proposer}
    return builder.stage("outcome", f"seed {config.training.seed}", settings, inputs, hints)


def _given_judge(config: Config, checkpoint: Path | None) -> Path | None:
    """The folder of a finished predictor; None: it is to be trained."""
    wanted = config.outcome.judge
    if wanted == "train":
        return None
    if not wanted:
        return checkpoint if checkpoint and (checkpoint / JUDGE).is_file() else None
    from dmfc.prediction.models import shipped_folder

    folder = shipped_folder(wanted) or Path(wanted).expanduser().absolute()
    if not (folder / JUDGE).is_file():
        raise DmfcError(f"outcome.judge: there is no {JUDGE} in {folder}")
    return folder
