"""The whole typed configuration."""

from __future__ import annotations

from dataclasses import dataclass

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
    hand: HandConfig = setting(HandConfig, "the hand")
    objects: ObjectsConfig = setting(ObjectsConfig, "objects and their preparation")
    physics: PhysicsConfig = setting(PhysicsConfig, "simulated physics")
    grasps: GraspsConfig = setting(GraspsConfig, "the planner of ground-truth grasps")
    scenes: ScenesConfig = setting(ScenesConfig, "scenes and cameras")
    matching: MatchingConfig = setting(MatchingConfig, "label matching")
    network: NetworkConfig = setting(NetworkConfig, "the network")
    losses: LossConfig = setting(LossConfig, "losses and their weights")
    training: TrainingConfig = setting(TrainingConfig, "the two-stage schedule")
    validation: ValidationConfig = setting(ValidationConfig, "validation on held-out objects")
    execution: ExecutionConfig = setting(ExecutionConfig, "execution in MuJoCo")
    outcome: OutcomeConfig = setting(OutcomeConfig, "the predictor of what becomes of a grasp")
    run: RunConfig = setting(RunConfig, "resources; never part of a stage's key")
