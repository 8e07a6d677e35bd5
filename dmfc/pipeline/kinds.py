"""The kinds of stage of this project, and where the function of each one is."""

from __future__ import annotations

from dmfc.config.schema import Config
from dmfc.engine.kinds import Registry, StageKind, registry
from dmfc.pipeline import effort


def _training_cpus(config: Config) -> int:
    return max(1, config.training.threads + config.training.loader_workers)


def _training_gpus(config: Config) -> float:
    return config.run.gpus_per_training


KINDS: Registry = registry(
    StageKind(
        "hand",
        "dmfc.pipeline.stages:make_hand",
        version=1,
        effort=effort.always(effort.HAND_SECONDS),
    ),
    StageKind(
        "object",
        "dmfc.pipeline.stages:prepare_object",
        version=1,
        effort=effort.always(effort.OBJECT_SECONDS),
        may_fail=True,
        identity=("object",),
    ),
    StageKind(
        "grasps",
        "dmfc.pipeline.stages:plan_grasps",
        version=3,
        effort=effort.of_grasps,
        may_fail=True,
        identity=("object",),
    ),
    StageKind(
        "scenes",
        "dmfc.pipeline.stages:make_scenes",
        version=2,
        identity=("start",),
        effort=effort.of_scenes,
    ),
    StageKind(
        "pretrain",
        "dmfc.pipeline.stages_training:pretrain",
        version=4,
        effort=effort.of_training("pretrain"),
        sized_by="scenes",
        cpus=_training_cpus,
        gpus=_training_gpus,
    ),
    StageKind(
        "finetune",
        "dmfc.pipeline.stages_training:finetune",
        version=4,
        effort=effort.of_training("finetune"),
        sized_by="scenes",
        cpus=_training_cpus,
        gpus=_training_gpus,
    ),
    StageKind(
        "rollouts",
        "dmfc.pipeline.stages_outcome:rollouts",
        version=1,
        may_fail=True,
        effort=effort.of_rollouts,
    ),
    StageKind(
        "outcome",
        "dmfc.pipeline.stages_outcome:outcome",
        version=1,
        effort=effort.always(effort.OUTCOME_SECONDS),
    ),
    StageKind(
        "evaluate",
        "dmfc.pipeline.stages:evaluate",
        version=7,
        identity=("row",),
        effort=effort.of_evaluation,
        sized_by="scenes",
    ),
)
