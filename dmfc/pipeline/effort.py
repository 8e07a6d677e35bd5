"""How much work a stage is, in units that take about the same time, and a guess of that time.

The guesses are the medians of `make reproduce` on two busy cores at 01fab29 (planned grasps: of the
smoke preset). They serve until a store has times of its own.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from dmfc.engine.kinds import Effort, Measure
from dmfc.files.digest import json_digest

Config = Mapping[str, Any]
HAND_SECONDS = 15.0
OBJECT_SECONDS = 3.9
OUTCOME_SECONDS = 130.0
TAKEN_SECONDS = 0.004
"""Of grasps that the library has."""
GRASP_SECONDS = 0.4
"""Of each grasp that is to be planned."""
SCENE_SECONDS = {"single": 0.17, "multi": 0.41}
EPOCH_SECONDS = {"pretrain": 0.082, "finetune": 0.12}
"""Of a scene in an epoch."""
TRIAL_SECONDS = {"model": 0.19, "planner": 0.38, "random": 0.03}
ROLLOUT_SECONDS = 3.0
"""Of an executed scene."""


def always(seconds: float) -> Measure:
    """Of a kind whose stages are all about as long."""

    def measure(config: Config, sizes: Sequence[Config]) -> Effort:
        return Effort(guess=seconds)

    return measure


def of_grasps(config: Config, sizes: Sequence[Config]) -> Effort:
    """Grasps are taken from the library, or planned."""
    if "library" in config:
        return Effort(like="library", guess=TAKEN_SECONDS)
    return Effort(config["grasps"]["per_object"], "planned", GRASP_SECONDS)


def of_scenes(config: Config, sizes: Sequence[Config]) -> Effort:
    """Scenes."""
    kind = config["set"]["kind"]
    return Effort(_scenes(config), kind, SCENE_SECONDS.get(kind, SCENE_SECONDS["single"]))


def of_training(kind: str) -> Measure:
    """Scenes times epochs, of one network."""

    def measure(config: Config, sizes: Sequence[Config]) -> Effort:
        scenes = sum(_scenes(size) for size in sizes)
        like = json_digest([config["network"], config["training"]["batch_size"]])[:8]
        return Effort(scenes * config["training"][kind]["epochs"], like, EPOCH_SECONDS[kind])

    return measure


def of_evaluation(config: Config, sizes: Sequence[Config]) -> Effort:
    """Trials, of a model, the planner, or at random; another score is another work."""
    execution = config["execution"]
    trials = execution["grasps_per_scene"] * sum(_scenes(size) for size in sizes)
    row = str(config["row"])
    return Effort(trials, f"{row} {execution.get('score', '')}", TRIAL_SECONDS.get(row, 0.19))


def of_rollouts(config: Config, sizes: Sequence[Config]) -> Effort:
    """Scenes in which predictions are executed."""
    return Effort(_scenes(config), guess=ROLLOUT_SECONDS)


def _scenes(shard: Config) -> int:
    """Scenes of a shard, from its settings."""
    return int(shard["stop"]) - int(shard["start"])
