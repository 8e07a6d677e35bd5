"""Settings of the outcome predictor: the trials that it learns from, and how it learns."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from dmfc.config.scenes import SensorConfig
from dmfc.config.setting import GREATEST_SEED, KEYS_VERSION, setting


@dataclass(frozen=True)
class RolloutsConfig:
    """Which predictions are executed in scenes of training objects."""

    per_object: int = setting(
        8, "Number of scenes of each object alone on the table.", least=0, greatest=1000
    )
    clutter: int = setting(
        0, "Number of scenes of several objects in each of the shards.", least=0, greatest=1000
    )
    shards: int = setting(0, "Number of shards of such scenes.", least=0, greatest=5000)
    min_objects: int = setting(3, "Fewest objects of a scene of several.", least=1, greatest=100)
    max_objects: int = setting(5, "Most objects of a scene of several.", least=1, greatest=100)
    source: Literal["predictions", "labels"] = setting(
        "predictions",
        "Grasps that are executed: the model's predictions, or planned labels moved by errors "
        "such as a network makes (labels: what is learned is then off-policy).",
        later=KEYS_VERSION,
    )
    uniform: int = setting(
        5,
        "Number of grasps of a scene drawn at random among those clear of the cloud.",
        least=0,
        greatest=1000,
    )
    confident: int = setting(
        2,
        "Number of grasps of a scene that are the most confident among those clear of the cloud.",
        least=0,
        greatest=1000,
    )
    refused: int = setting(
        2, "Number of grasps of a scene that the cloud is in the way of.", least=0, greatest=1000
    )
    hold_time: float = setting(
        0.5,
        "Time of holding after which a trial is judged; an evaluation holds for 2 s.",
        unit="s",
        least=0,
        greatest=100,
    )
    seed: int = setting(
        100, "Seed of the scenes and of the choice.", least=0, greatest=GREATEST_SEED
    )
    sensor: SensorConfig = setting(SensorConfig, "Errors of the cameras in these scenes.")

    def __post_init__(self) -> None:
        """Raises ValueError where nothing would be executed."""
        if self.per_object == 0 and self.clutter * self.shards == 0:
            raise ValueError(
                "there are no scenes: one of outcome.rollouts.per_object, outcome.rollouts.clutter "
                "(with outcome.rollouts.shards) must be above 0"
            )
        if self.uniform + self.confident < 1:
            raise ValueError(
                "nothing is executed: one of outcome.rollouts.uniform and "
                "outcome.rollouts.confident must be above 0"
            )


@dataclass(frozen=True)
class OutcomeConfig:
    """A predictor of what becomes of a grasp, trained on executed predictions."""

    objects: list[str] = setting(
        [], "Objects in whose scenes predictions are executed; empty: those of objects.train."
    )
    proposer: str = setting(
        "",
        "Model whose predictions are executed: a shipped one's name or a folder; empty: the model "
        "that is evaluated.",
    )
    judge: str = setting(
        "",
        "Predictor that is used: train, a shipped model's name or a folder; empty: the predictor "
        "in the folder of the evaluated model, or else train.",
    )
    form: Literal["features", "head"] = setting(
        "features",
        "What learns: networks of geometric features of each grasp, or the model's own confidence "
        "head with all else frozen (head, as in the paper).",
        later=KEYS_VERSION,
    )
    rollouts: RolloutsConfig = setting(RolloutsConfig, "The trials that it learns from.")
    members: int = setting(
        5,
        "Number of networks whose mean is the answer. Each learns without its share of the "
        "objects, by which it is calibrated.",
        least=2,
        greatest=100,
    )
    widths: list[int] = setting(
        [128, 64],
        "Hidden widths of each network; none: logistic regression.",
        least=1,
        greatest=10_000,
    )
    dropout: float = setting(
        0.2, "Share of hidden numbers that are left out in training.", least=0, greatest=0.95
    )
    noise: float = setting(
        0.1, "Standard deviation added to normalised features in training.", least=0, greatest=10
    )
    epochs: int = setting(40, "Number of epochs.", least=1, greatest=10_000)
    batch_size: int = setting(128, "Trials per batch.", least=1, greatest=100_000)
    learning_rate: float = setting(
        1e-3,
        "Learning rate of AdamW at the start; it falls to 0 by a cosine.",
        least=1e-9,
        greatest=10,
    )
    weight_decay: float = setting(1e-2, "Weight decay of AdamW.", least=0, greatest=100)
