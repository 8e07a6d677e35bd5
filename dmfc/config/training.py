"""Settings of the two-stage training."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from dmfc.config.setting import setting


@dataclass(frozen=True)
class StageSchedule:
    epochs: int = setting(50, "epochs")
    learning_rate: float = setting(1e-3, "Adam's learning rate at the start")
    decay: float = setting(0.9, "factor applied every `decay_every` epochs")
    decay_every: int = setting(10, "epochs between two decays")

    def __post_init__(self) -> None:
        """Raises ValueError for a schedule that cannot be run."""
        if self.epochs < 1 or self.decay_every < 1 or self.learning_rate <= 0:
            raise ValueError(
                "training: epochs and decay_every must be at least 1, learning_rate positive"
            )


@dataclass(frozen=True)
class TrainingConfig:
    batch_size: int = setting(4, "scenes per batch")
    pretrain: StageSchedule = setting(StageSchedule, "stage 1: chamfer and confidence only")
    finetune: StageSchedule = setting(StageSchedule(epochs=20), "stage 2: the task loss")
    hard_samples: int = setting(
        64, "predictions with the highest error that are back-propagated; 0: all"
    )
    hard_error: Literal["task", "weighted"] = setting(
        "weighted", "the error that ranks: the task loss, or the confidence times the task loss"
    )
    hard_scope: Literal["batch", "scene"] = setting("batch", "where the hardest are chosen")
    hard_stages: Literal["both", "finetune"] = setting(
        "both", "stages in which only the hardest count; the paper chooses 'during training'"
    )
    finetune_seeds: Literal["all", "labelled"] = setting(
        "all",
        "seed points whose predictions have the task loss in fine-tuning; of those without a label "
        "it has no chamfer, so that they look like the better ones; labelled: not they",
        later=True,
    )
    rank_points: int = setting(
        250, "collision points of the hand used to find the hardest; 0: all, the exact ranking"
    )
    negatives: Literal["ignore", "push_down"] = setting(
        "ignore", "confidence at seeds without a label: free (the paper), or -log(1 - c) is added"
    )
    max_gradient_norm: float = setting(0.0, "gradients are scaled down to this norm; 0: never")
    precision: Literal["32-true", "bf16-mixed"] = setting("32-true", "Lightning's precision")
    accelerator: str = setting("auto", "Lightning's accelerator", resource=True)
    devices: int = setting(1, "devices")
    threads: int = setting(1, "CPU threads of a training process", resource=True)
    loader_workers: int = setting(0, "worker processes of the data loader", resource=True)
    seed: int = setting(0, "seed of weights, order and augmentation")
