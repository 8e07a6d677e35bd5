"""Settings of the outcome predictor: the trials that it learns from, and how it learns."""

from __future__ import annotations

from dataclasses import dataclass

from dmfc.config.scenes import SensorConfig
from dmfc.config.setting import setting


@dataclass(frozen=True)
class RolloutsConfig:
    """Which predictions are executed in scenes of training objects."""

    per_object: int = setting(8, "scenes of each object alone on the table")
    clutter: int = setting(0, "scenes of several of the objects, per shard of `shards`")
    shards: int = setting(0, "shards of scenes of several objects")
    min_objects: int = setting(3, "fewest objects of a scene of several")
    max_objects: int = setting(5, "most objects of a scene of several")
    uniform: int = setting(5, "grasps of a scene, at random among those clear of the cloud")
    confident: int = setting(2, "grasps of a scene, the most confident of those clear of the cloud")
    refused: int = setting(2, "grasps of a scene that the cloud is in the way of")
    hold_time: float = setting(0.5, "s of hold that decide whether a trial held; evaluation: 2 s")
    seed: int = setting(100, "seed of the scenes and of the choice")
    sensor: SensorConfig = setting(SensorConfig, "errors of the cameras in these scenes")

    def __post_init__(self) -> None:
        """Raises ValueError where nothing would be executed."""
        if min(self.per_object, self.clutter, self.shards, self.refused) < 0:
            raise ValueError("outcome.rollouts: numbers of scenes and grasps are not negative")
        if self.per_object == 0 and self.clutter * self.shards == 0:
            raise ValueError("outcome.rollouts has no scenes: set per_object or clutter")
        if self.uniform + self.confident < 1:
            raise ValueError("outcome.rollouts executes nothing: set uniform or confident")


@dataclass(frozen=True)
class OutcomeConfig:
    """A predictor of what becomes of a grasp, trained on executed predictions."""

    objects: list[str] = setting(
        [], "objects whose scenes are executed, as selectors; empty: objects.train"
    )
    proposer: str = setting(
        "",
        "model whose predictions are executed: a shipped one's name or a folder; empty: the "
        "cell's own",
    )
    judge: str = setting(
        "",
        "predictor that is used: train, a shipped model's name or a folder; empty: the one in "
        "the folder of the executed model, or else train",
    )
    rollouts: RolloutsConfig = setting(RolloutsConfig, "the trials that it learns from")
    members: int = setting(
        5,
        "networks whose mean is the answer; each learns without its share of the objects, by "
        "which it is calibrated",
    )
    widths: list[int] = setting([128, 64], "hidden widths of each; none: logistic regression")
    dropout: float = setting(0.2, "share of hidden numbers that are left out in training")
    noise: float = setting(0.1, "standard deviation added to normalised features in training")
    epochs: int = setting(40, "epochs")
    batch_size: int = setting(128, "trials per batch")
    learning_rate: float = setting(1e-3, "AdamW's learning rate at the start; it falls to 0")
    weight_decay: float = setting(1e-2, "AdamW's weight decay")

    def __post_init__(self) -> None:
        """Raises ValueError for a predictor that cannot be trained."""
        if self.members < 2 or self.epochs < 1 or self.batch_size < 1:
            raise ValueError("outcome: members must be at least 2, epochs and batch_size 1")
        if not 0 <= self.dropout < 1 or self.learning_rate <= 0 or self.noise < 0:
            raise ValueError(
                "outcome: dropout must be in [0, 1), learning_rate positive, noise not negative"
            )
