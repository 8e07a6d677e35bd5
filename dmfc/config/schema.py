"""The whole typed configuration."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from dmfc.config.closing import ClosingConfig
from dmfc.config.execution import ExecutionConfig
from dmfc.config.grasps import GraspsConfig
from dmfc.config.hand import HandConfig
from dmfc.config.losses import LossConfig
from dmfc.config.network import NetworkConfig
from dmfc.config.objects import ObjectsConfig
from dmfc.config.outcome import OutcomeConfig
from dmfc.config.physics import PhysicsConfig
from dmfc.config.scenes import MatchingConfig, ScenesConfig
from dmfc.config.setting import setting
from dmfc.config.sweep import RunConfig
from dmfc.config.training import TrainingConfig
from dmfc.config.validation import ValidationConfig


@dataclass(frozen=True)
class Config:
    hand: HandConfig = setting(HandConfig, "The hand.")
    closing: ClosingConfig = setting(ClosingConfig, "How the fingers close on an object.")
    objects: ObjectsConfig = setting(ObjectsConfig, "Objects and their preparation.")
    physics: PhysicsConfig = setting(PhysicsConfig, "Simulated physics.")
    grasps: GraspsConfig = setting(GraspsConfig, "The planner of ground-truth grasps.")
    scenes: ScenesConfig = setting(ScenesConfig, "Scenes and cameras.")
    matching: MatchingConfig = setting(MatchingConfig, "Matching of labels to points.")
    network: NetworkConfig = setting(NetworkConfig, "The network.")
    losses: LossConfig = setting(LossConfig, "Losses and their weights.")
    training: TrainingConfig = setting(TrainingConfig, "Training in two stages.")
    validation: ValidationConfig = setting(ValidationConfig, "Validation on held-out objects.")
    execution: ExecutionConfig = setting(ExecutionConfig, "Execution of grasps in MuJoCo.")
    outcome: OutcomeConfig = setting(OutcomeConfig, "The predictor of what becomes of a grasp.")
    run: RunConfig = setting(RunConfig, "Resources, which never enter a stage's key.")

    def __post_init__(self) -> None:
        """Raises ValueError where settings of different groups contradict each other."""
        sets: dict[str, Any] = {
            "scenes.train": self.scenes.train,
            "scenes.test": self.scenes.test,
            "validation.scenes": self.validation.scenes,
            "outcome.rollouts": self.outcome.rollouts,
        }
        for name, scenes in sets.items():
            if scenes.min_objects > scenes.max_objects:
                raise ValueError(
                    f"{name}.min_objects ({scenes.min_objects}) must not be above "
                    f"{name}.max_objects ({scenes.max_objects})"
                )
            cameras = scenes.sensor.cameras
            if not cameras or any(cameras.count(camera) > 1 for camera in cameras):
                raise ValueError(
                    f"{name}.sensor.cameras must name at least one camera, each once: {cameras}"
                )
        seeds = self.network.levels[0]
        if seeds > self.scenes.points:
            raise ValueError(
                f"network.levels begins with {seeds} seed points, more than the "
                f"{self.scenes.points} of scenes.points"
            )
