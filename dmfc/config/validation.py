"""Settings of validation, which measures a model during training without a simulator."""

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
        [],
        "Objects held out of training, as selectors, with scenes and grasps of their own; "
        "empty: no validation.",
    )
    scenes: SceneSetConfig = setting(
        SceneSetConfig(count=16, seed=2), "Scenes of the validation objects."
    )
    every: int = setting(1, "Epochs between two validations.", least=1, greatest=100_000)
    confident: int = setting(
        16,
        "Number of predictions of a scene, the most confident ones, whose penetration and Q1 are "
        "measured.",
        least=1,
        greatest=16_384,
    )
    sampled: int = setting(
        32,
        "Number of predictions of a scene, spread over its seed points, whose loss terms are "
        "measured.",
        least=1,
        greatest=16_384,
    )
    near_distance: float = setting(
        0.02,
        "A label is covered if a prediction is this near in position.",
        unit="m",
        least=0,
        greatest=1,
    )
    near_angle: float = setting(
        0.35,
        "A label is covered if that prediction is turned by at most this.",
        unit="rad",
        least=0,
        greatest=3.15,
    )
    torque_weight: float = setting(
        10.0,
        "Weight of torques in the measured Q1. At 10, a lever arm of 10 cm counts as 1.",
        unit="1/m",
        least=0,
        greatest=100_000,
    )
