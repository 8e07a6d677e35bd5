"""The kinds of stage: where each one's function is, its version, and what it may use."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from dmfc.config.schema import Config
from dmfc.errors import unknown_name


def _one_cpu(config: Config) -> int:
    return 1


def _no_gpu(config: Config) -> float:
    return 0.0


def _training_cpus(config: Config) -> int:
    return max(1, config.training.threads + config.training.loader_workers)


def _training_gpus(config: Config) -> float:
    return config.run.gpus_per_training


@dataclass(frozen=True)
class StageKind:
    """How one kind of stage is run.

    `entry` is 'package.module:function', imported in the worker alone. Raise `version` when a
    change of the code changes what the stage writes: what the old code made is then made again.
    """

    name: str
    entry: str
    version: int
    cpus: Callable[[Config], int] = _one_cpu
    gpus: Callable[[Config], float] = _no_gpu


Registry = Mapping[str, StageKind]


def registry(*kinds: StageKind) -> dict[str, StageKind]:
    """The kinds by name."""
    return {kind.name: kind for kind in kinds}


KINDS: Registry = registry(
    StageKind("hand", "dmfc.sweep.stages:make_hand", version=1),
    StageKind("object", "dmfc.sweep.stages:prepare_object", version=1),
    StageKind("grasps", "dmfc.sweep.stages:plan_grasps", version=1),
    StageKind("scenes", "dmfc.sweep.stages:make_scenes", version=1),
    StageKind(
        "pretrain",
        "dmfc.sweep.stages:pretrain",
        version=1,
        cpus=_training_cpus,
        gpus=_training_gpus,
    ),
    StageKind(
        "finetune",
        "dmfc.sweep.stages:finetune",
        version=1,
        cpus=_training_cpus,
        gpus=_training_gpus,
    ),
    StageKind("evaluate", "dmfc.sweep.stages:evaluate", version=1),
)


def kind_of(name: str, kinds: Registry = KINDS) -> StageKind:
    """The kind called `name`. Raises DmfcError naming the nearest one."""
    if name not in kinds:
        raise unknown_name("kind of stage", name, kinds)
    return kinds[name]
