"""Settings of the two-stage training."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from dmfc.config.setting import GREATEST_SEED, setting


@dataclass(frozen=True)
class StageSchedule:
    epochs: int = setting(50, "Number of epochs.", least=1, greatest=100_000)
    learning_rate: float = setting(
        1e-3, "Adam's learning rate at the start.", least=1e-12, greatest=10
    )
    decay: float = setting(
        0.9,
        "Factor applied to the learning rate every `decay_every` epochs.",
        least=1e-6,
        greatest=1,
    )
    decay_every: int = setting(10, "Epochs between two decays.", least=1, greatest=100_000)


@dataclass(frozen=True)
class TrainingConfig:
    batch_size: int = setting(4, "Scenes per batch.", least=1, greatest=4096)
    pretrain: StageSchedule = setting(
        StageSchedule, "Pre-training (stage 1), with chamfer and confidence alone."
    )
    finetune: StageSchedule = setting(
        StageSchedule(epochs=20, learning_rate=1.5e-6),
        "Fine-tuning (stage 2), with the whole task loss.",
    )
    hard_samples: int = setting(
        64,
        "Number of predictions that are back-propagated, those with the highest error; 0: all.",
        least=0,
        greatest=1_000_000,
    )
    hard_error: Literal["task", "weighted"] = setting(
        "weighted",
        "Error that ranks the predictions. 'task': the task loss; 'weighted': the confidence "
        "times the task loss.",
    )
    hard_scope: Literal["batch", "scene"] = setting(
        "scene", "Whether the hardest predictions are chosen in the whole batch or in each scene."
    )
    hard_stages: Literal["both", "finetune"] = setting(
        "finetune",
        "Stages of training in which only the hardest predictions count. The paper chooses them "
        "'during training'.",
    )
    finetune_seeds: Literal["all", "labelled"] = setting(
        "labelled",
        "Which seed points contribute to the loss of fine-tuning: all, or only those with a "
        "matched label. Seed points without a label have no chamfer term and therefore look "
        "better than they are.",
    )
    rank_points: int = setting(
        250,
        "Number of the hand's collision points used to find the hardest predictions; 0: all, for "
        "the exact ranking.",
        least=0,
        greatest=100_000,
    )
    negatives: Literal["ignore", "push_down"] = setting(
        "push_down",
        "Confidence at seed points without a label. 'ignore': not trained, as in the paper; "
        "'push_down': -log(1 - c) is added to the loss.",
    )
    max_gradient_norm: float = setting(
        1.0,
        "Larger gradients are scaled down to this norm; 0: gradients are not scaled.",
        least=0,
        greatest=1e6,
    )
    precision: Literal["32-true", "bf16-mixed"] = setting(
        "32-true", "Numerical precision, as Lightning names it."
    )
    accelerator: Literal["auto", "cpu", "gpu", "cuda", "mps"] = setting(
        "auto", "Device that trains, as Lightning names it.", resource=True
    )
    devices: int = setting(1, "Number of devices per training.", least=1, greatest=1024)
    threads: int = setting(
        1, "CPU threads of a training process.", least=1, greatest=1024, resource=True
    )
    loader_workers: int = setting(
        0, "Worker processes of the data loader.", least=0, greatest=1024, resource=True
    )
    seed: int = setting(
        0, "Seed of weights, order and augmentation.", least=0, greatest=GREATEST_SEED
    )
