"""Settings of the two-stage training."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from dmfc.config.setting import GREATEST_SEED, KEYS_VERSION, setting


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
class ProjectionConfig:
    """Projected targets: how far a prediction is moved down its own terms."""

    weight: float = setting(
        4.0,
        "Weight of the squared distance to the moved prediction, beside that of chamfer.",
        least=0,
        greatest=1e6,
    )
    steps: int = setting(8, "Steps of each prediction.", least=1, greatest=1000)
    position: float = setting(
        0.01, "Greatest motion of the palm.", unit="m", least=1e-6, greatest=1
    )
    angle: float = setting(
        0.17, "Greatest rotation of the palm.", unit="rad", least=1e-6, greatest=3
    )
    joints: float = setting(0.2, "Greatest change of a joint.", unit="rad", least=1e-6, greatest=3)
    worse: float = setting(
        0.1,
        "Share by which a single term may grow above its value at the prediction. A step after "
        "which one is above that, or their sum has not fallen, is not taken.",
        least=0,
        greatest=100,
    )


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
    hard_error: Literal["task", "weighted", "random"] = setting(
        "weighted",
        "Error that ranks the predictions. 'task': the task loss; 'weighted': the confidence "
        "times the task loss; 'random': none, they are drawn at random.",
    )
    finetune_form: Literal["gradient", "projected"] = setting(
        "gradient",
        "How the terms other than chamfer move the network in fine-tuning. 'gradient': by the "
        "gradient of their sum, as in the paper; 'projected': each prediction is moved down its "
        "own terms by bounded steps, and the network is drawn to where it went.",
        later=KEYS_VERSION,
    )
    finetune_from: str = setting(
        "",
        "Trained model that fine-tuning starts from: a shipped one's name or a folder. Empty: "
        "the pre-training of these settings.",
        later=KEYS_VERSION,
    )
    projection: ProjectionConfig = setting(
        ProjectionConfig, "Projected targets.", later=KEYS_VERSION
    )
    diagnostic_scenes: int = setting(
        0,
        "Training scenes on which it is measured after each epoch of fine-tuning what the terms do "
        "to predictions and labels; 0: none.",
        least=0,
        greatest=1000,
        later=KEYS_VERSION,
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
