"""`FitConfig`: the settings that decide what is learned."""

from __future__ import annotations

from dataclasses import dataclass, field

from dmfc.config.execution import ExecutionConfig
from dmfc.config.losses import LossConfig
from dmfc.config.network import NetworkConfig
from dmfc.config.setting import setting
from dmfc.config.training import TrainingConfig
from dmfc.config.validation import ValidationConfig
from dmfc.hand.approach import Approach


@dataclass(frozen=True)
class FitConfig:
    """The settings that decide what is learned, and what is measured meanwhile."""

    network: NetworkConfig = setting(NetworkConfig, "the network")
    losses: LossConfig = setting(LossConfig, "losses and their weights")
    training: TrainingConfig = setting(TrainingConfig, "the two-stage schedule")
    validation: ValidationConfig = setting(ValidationConfig, "validation on held-out objects")
    approach: Approach = field(default_factory=lambda: Approach.of_execution(ExecutionConfig()))
    """The approach that is swept."""
