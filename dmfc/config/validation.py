"""Settings of validation: how good a model is, measured without a simulator while it learns."""

from __future__ import annotations

from dataclasses import dataclass

from dmfc.config.scenes import SceneSetConfig
from dmfc.config.setting import setting

MEASURES = (
    "coverage",
    "translation_mm",
    "rotation_deg",
    "joints_deg",
    "penetration_mm",
    "measured_q1_upper",
    "measured_q1_lower",
    "chamfer",
    "collision",
    "guidance",
    "q1_upper",
    "q1_lower",
    "positive_rate",
    "confidence",
    "confidence_gap",
    "confidence_rank",
    "rank_overlap",
)
"""What validation measures, as `metrics.jsonl` names it."""


@dataclass(frozen=True)
class ValidationConfig:
    objects: list[str] = setting(
        [], "objects held out of training, as selectors, with grasps of their own; empty: none"
    )
    scenes: SceneSetConfig = setting(SceneSetConfig(count=16, seed=2), "scenes of them")
    every: int = setting(1, "epochs between two validations")
    confident: int = setting(
        16, "predictions of a scene, the most confident, whose penetration and Q1 are measured"
    )
    sampled: int = setting(
        32, "predictions of a scene, spread over its seeds, whose loss terms are measured"
    )
    near_distance: float = setting(0.02, "a label is covered by a prediction this near, metres")
    near_angle: float = setting(0.35, "and turned by at most this, rad")
    torque_weight: float = setting(10.0, "1/m; torques in the measured Q1 (10: arms of 10 cm as 1)")

    def __post_init__(self) -> None:
        """Raises ValueError for a validation of nothing."""
        if min(self.every, self.confident, self.sampled) < 1:
            raise ValueError("validation: every, confident and sampled must be at least 1")
