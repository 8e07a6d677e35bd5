"""Settings of resources: what each kind of stage may use."""

from __future__ import annotations

from dataclasses import dataclass

from dmfc.config.setting import setting


@dataclass(frozen=True)
class StageLimits:
    """What one kind of stage may use; 0 leaves what the kind itself wants."""

    cpus: int = setting(
        0, "CPUs per stage; 0: what the kind of stage wants.", least=0, greatest=4096
    )
    gpus: float = setting(
        0.0,
        "GPUs per stage (fractions are allowed); 0: what the kind of stage wants.",
        least=0,
        greatest=64,
    )
    memory_gb: float = setting(
        0.0,
        "Memory that must be free before a stage starts; 0: none.",
        unit="GB",
        least=0,
        greatest=100_000,
    )
    seconds: float = setting(
        0.0, "Time limit of a stage; 0: none.", unit="s", least=0, greatest=10_000_000
    )
    retries: int = setting(
        -1, "Attempts after a stage died; -1: run.retries.", least=-1, greatest=1000
    )


@dataclass(frozen=True)
class RunConfig:
    """How stages are run; never part of a stage's key."""

    cpus: int = setting(0, "CPUs that Ray may use; 0: all.", least=0, greatest=100_000)
    gpus_per_training: float = setting(
        0.0, "GPUs per training (fractions are allowed).", least=0, greatest=64
    )
    retries: int = setting(1, "Attempts after a stage died.", least=0, greatest=1000)
    search_trials: int = setting(
        0, "Trials of a search; 0: the number in its sweep file.", least=0, greatest=100_000
    )
    ray_address: str = setting(
        "", "Address of a running Ray cluster; empty: one is started on this machine."
    )
    scales_up: bool = setting(
        False, "Whether the cluster at ray_address starts nodes when stages wait for them."
    )
    tracking_uri: str = setting("", "MLflow tracking URI; empty: an SQLite file in the store.")
    tracking_seconds: float = setting(
        5.0,
        "Time between two updates of MLflow; 0: only at the end.",
        unit="s",
        least=0,
        greatest=100_000,
    )
    system_seconds: float = setting(
        10.0,
        "Time between two samples of a stage's CPU, memory and GPU use.",
        unit="s",
        least=0,
        greatest=100_000,
    )
    hand: StageLimits = setting(StageLimits, "Limits of preparing the hand.")
    object: StageLimits = setting(StageLimits, "Limits of preparing one object.")
    grasps: StageLimits = setting(StageLimits, "Limits of planning one object's grasps.")
    scenes: StageLimits = setting(StageLimits, "Limits of making one shard of scenes.")
    pretrain: StageLimits = setting(StageLimits, "Limits of one pre-training.")
    finetune: StageLimits = setting(StageLimits, "Limits of one fine-tuning.")
    evaluate: StageLimits = setting(StageLimits, "Limits of one shard of evaluation.")
