"""Settings of execution in MuJoCo: selection, planning, trajectory and success."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

from dmfc.config.setting import setting


@dataclass(frozen=True)
class ExecutionConfig:
    protocol: str = setting(
        "paper", "settings that hold in execution alone: paper, dexgraspbench, or a YAML file"
    )
    changes: dict[str, Any] = setting(
        {}, "the same, key by key, over the protocol: {physics.hand_friction: 0.7}"
    )
    grasps_per_scene: int = setting(4, "K")
    score: Literal["confidence", "opposition", "outcome"] = setting(
        "confidence",
        "by what grasps are ranked: the network's confidence; how far thumb and fingers oppose "
        "each other once they are closed on the cloud; or the probability of being held that an "
        "outcome predictor gives them (settings outcome.*)",
        later=True,
    )
    min_confidence: float = setting(
        0.15, "predictions below this are dropped, where confidence ranks"
    )
    confidence_unit: Literal["one", "weight"] = setting(
        "one",
        "unit of min_confidence: 1, or losses.weights.confidence (w5), at which a task loss of "
        "1 / min_confidence is the most that passes, whatever w5 is",
        later=True,
    )
    most_confident: int = setting(
        0, "predictions left of those, the most confident, before K are spread; 0: all"
    )
    cloud_check: bool = setting(
        False,
        "before K are chosen, drop grasps whose hand would have points of the cloud inside, or "
        "reach into the table, on the way that planning checks; the paper drops none",
        later=True,
    )
    cloud_margin: float = setting(
        0.0,
        "metres by which the cloud check is stricter at first; those that pass only without it "
        "fill up what is missing of K",
        later=True,
    )
    seed: int = setting(0, "seed of the random row")
    random_offset: float = setting(0.1, "random row: palm within this of a seed point, metres")

    pregrasp_distance: float = setting(
        0.1, "retreat of the pre-grasp along the palm normal, metres"
    )
    waypoints: int = setting(5, "poses of the approach that are checked for collision")
    approach_tolerance: float = setting(
        0.003, "penetration of open hand and table or object up to the grasp pose, metres"
    )
    grasp_tolerance: float = setting(
        0.03,
        "penetration of the fingers at the angles they are closed to and their target, metres; "
        "contact stops them before, as it does in the squeeze",
    )

    start: Literal["rest", "pregrasp"] = setting(
        "rest", "the hand comes from its resting pose, or begins at the pre-grasp"
    )
    rest_height: float = setting(0.4, "height of the palm in its resting pose, metres")
    min_rise: float = setting(
        0.1, "least height of the lift, for a grasp near or above the resting height, metres"
    )
    settle_time: float = setting(0.2, "s, the scene comes to rest before the hand moves")
    raise_time: float = setting(0.3, "s, resting pose to the pose above the pre-grasp")
    descend_time: float = setting(0.4, "s, down to the pre-grasp")
    approach_time: float = setting(0.4, "s, pre-grasp to grasp pose")
    close_time: float = setting(0.5, "s, the fingers close")
    squeeze_time: float = setting(0.2, "s, the fingers hold on before the lift")
    lift_time: float = setting(1.0, "s, straight up to the resting height")
    hold_time: float = setting(2.0, "s, at the resting height")

    knock_distance: float = setting(0.08, "object moved farther before the lift: knocked away, m")
    lift_fraction: float = setting(0.5, "share of the lift that the object must have come along")
    max_slip: float = setting(
        0.0, "farthest that the object may have moved in the hand since the lift began, m; 0: any"
    )
    max_turn: float = setting(0.0, "the same for how far it turned, rad; 0: any")
    palm_distance: float = setting(0.2, "object's centre farther from the palm: not held, metres")
    lost_time: float = setting(0.2, "s without contact after which a lifted object is lost")
    blow_up_speed: float = setting(
        10.0, "m/s; an object with more kinetic energy per mass than at this speed: diverged"
    )
