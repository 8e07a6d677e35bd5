"""Settings of the grasp planner (ground truth)."""

from __future__ import annotations

from dataclasses import dataclass

from dmfc.config.setting import setting


@dataclass(frozen=True)
class GraspsConfig:
    per_object: int = setting(100, "verified grasps wanted per object")
    max_candidates: int = setting(2000, "candidates tried per object before the planner gives up")
    batch: int = setting(128, "candidates proposed at a time")
    seed: int = setting(0, "seed of the planner")
