"""Settings of resources: what each kind of stage may use."""

from __future__ import annotations

from dataclasses import dataclass

from dmfc.config.setting import setting


@dataclass(frozen=True)
class StageLimits:
    """What one kind of stage may use; 0 leaves the kind's own."""

    cpus: int = setting(0, "CPUs per stage")
    gpus: float = setting(0.0, "GPUs per stage (fractions allowed)")
    memory_gb: float = setting(0.0, "memory that Ray must have free to start one")
    seconds: float = setting(0.0, "time limit; 0: none")
    retries: int = setting(-1, "attempts after a death; -1: run.retries")


@dataclass(frozen=True)
class RunConfig:
    """How stages are run; never part of a stage's key."""

    cpus: int = setting(0, "CPUs that Ray may use; 0: all")
    gpus_per_training: float = setting(0.0, "GPUs per training stage (fractions allowed)")
    retries: int = setting(1, "attempts after a stage died")
    search_trials: int = setting(0, "trials of a search; 0: as its sweep file says")
    ray_address: str = setting("", "address of a running Ray cluster; empty starts one here")
    scales_up: bool = setting(False, "the cluster starts nodes when stages wait for them")
    tracking_uri: str = setting("", "MLflow tracking URI; empty: SQLite in the store")
    tracking_seconds: float = setting(5.0, "s between two updates of MLflow; 0: at the end alone")
    system_seconds: float = setting(10.0, "s between two samples of a stage's CPU, memory and GPU")
    hand: StageLimits = setting(StageLimits, "limits of preparing the hand")
    object: StageLimits = setting(StageLimits, "limits of preparing one object")
    grasps: StageLimits = setting(StageLimits, "limits of planning one object's grasps")
    scenes: StageLimits = setting(StageLimits, "limits of one shard of scenes")
    pretrain: StageLimits = setting(StageLimits, "limits of stage 1 of training")
    finetune: StageLimits = setting(StageLimits, "limits of stage 2 of training")
    evaluate: StageLimits = setting(StageLimits, "limits of one shard of evaluation")
