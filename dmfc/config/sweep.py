"""Settings of resources: what each kind of stage may use."""

from __future__ import annotations

from dataclasses import dataclass

from dmfc.config.setting import setting


@dataclass(frozen=True)
class RunConfig:
    """How stages are run; never part of a stage's key."""

    cpus: int = setting(0, "CPUs that Ray may use; 0: all")
    gpus_per_training: float = setting(0.0, "GPUs per training stage (fractions allowed)")
    retries: int = setting(1, "attempts after a stage died")
    ray_address: str = setting("", "address of a running Ray cluster; empty starts one here")
    tracking_uri: str = setting("", "MLflow tracking URI; empty: SQLite in the store")
