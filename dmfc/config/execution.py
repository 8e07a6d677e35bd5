"""Settings of execution in MuJoCo."""

from __future__ import annotations

from dataclasses import dataclass

from dmfc.config.setting import setting


@dataclass(frozen=True)
class ExecutionConfig:
    grasps_per_scene: int = setting(4, "K")
    min_confidence: float = setting(0.15, "predictions below this are dropped")
    seed: int = setting(0, "seed of the random row and of the selection")
