"""Settings of execution in MuJoCo: selection, planning, trajectory and success."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

from dmfc.config.setting import GREATEST_SEED, KEYS_VERSION, setting


@dataclass(frozen=True)
class ExecutionConfig:
    protocol: str = setting(
        "default",
        "Settings that hold in execution alone: default, dexgraspbench, six_directions, or a YAML "
        "file.",
    )
    test: str = setting(
        "lift",
        "Motion and success test: lift (docs/execution.md), six_directions, or file.py:Class. A "
        "protocol sets it.",
        later=KEYS_VERSION,
    )
    changes: dict[str, Any] = setting(
        {},
        "Changes of the protocol, setting by setting: {physics.hand_friction: 0.7}.",
    )
    grasps_per_scene: int = setting(
        4, "Number of grasps executed per scene (K).", least=1, greatest=1000
    )
    score: Literal["confidence", "opposition", "outcome"] = setting(
        "confidence",
        "What ranks the grasps: the network's confidence; how far thumb and fingers oppose each "
        "other once they are closed on the cloud; or the probability of being held that an "
        "outcome predictor gives (settings outcome.*).",
        later=KEYS_VERSION,
    )
    min_confidence: float = setting(
        0.15,
        "Predictions with less confidence are not executed, where the confidence ranks.",
        least=0,
        greatest=1,
    )
    confidence_unit: Literal["one", "weight"] = setting(
        "one",
        "Unit of min_confidence: 1, or losses.weights.confidence (w5). In units of w5 the "
        "greatest task loss that passes is 1 / min_confidence, whatever w5 is.",
        later=KEYS_VERSION,
    )
    most_confident: int = setting(
        32,
        "Number of predictions, the most confident, among which the K executed ones are spread; "
        "0: all.",
        least=0,
        greatest=1_000_000,
    )
    cloud_check: bool = setting(
        False,
        "Reject grasps whose hand would collide with points of the observed cloud, or reach into "
        "the table, on the approach that planning checks. The paper rejects none.",
    )
    cloud_margin: float = setting(
        0.0,
        "Margin by which the cloud check is stricter at first. Grasps that pass only without it "
        "fill up what is missing of K.",
        unit="m",
        least=0,
        greatest=0.1,
        later=KEYS_VERSION,
    )
    seed: int = setting(0, "Seed of the random grasps.", least=0, greatest=GREATEST_SEED)
    random_offset: float = setting(
        0.1,
        "Random grasps: greatest distance of the palm from a seed point.",
        unit="m",
        least=0,
        greatest=1,
    )

    pregrasp_distance: float = setting(
        0.1,
        "Distance of the pre-grasp from the grasp, back along the palm normal.",
        unit="m",
        least=0,
        greatest=1,
    )
    waypoints: int = setting(
        5, "Poses of the approach that are checked for collision.", least=2, greatest=1000
    )
    approach_tolerance: float = setting(
        0.003,
        "Penetration of the open hand into table or object that is allowed on the approach.",
        unit="m",
        least=0,
        greatest=0.1,
    )
    grasp_tolerance: float = setting(
        0.03,
        "Penetration of the closed fingers into their object that is allowed at the grasp pose, "
        "where contact stops the fingers earlier.",
        unit="m",
        least=0,
        greatest=0.2,
    )

    start: Literal["rest", "pregrasp"] = setting(
        "rest", "Where the motion starts: at the resting pose of the hand, or at the pre-grasp."
    )
    rest_height: float = setting(
        0.4, "Height of the palm in its resting pose.", unit="m", least=0, greatest=5
    )
    min_rise: float = setting(
        0.1,
        "Least height of the lift, for a grasp near or above the resting height.",
        unit="m",
        least=0.01,
        greatest=5,
    )
    settle_time: float = setting(
        0.2,
        "Time for the scene to come to rest before the hand moves.",
        unit="s",
        least=0,
        greatest=60,
    )
    raise_time: float = setting(
        0.3, "From the resting pose to above the pre-grasp.", unit="s", least=0.01, greatest=60
    )
    descend_time: float = setting(0.4, "Down to the pre-grasp.", unit="s", least=0.01, greatest=60)
    approach_time: float = setting(
        0.4, "From the pre-grasp to the grasp pose.", unit="s", least=0.01, greatest=60
    )
    close_time: float = setting(0.5, "Closing of the fingers.", unit="s", least=0.01, greatest=60)
    squeeze_time: float = setting(
        0.2, "Squeeze of the closed fingers before the lift.", unit="s", least=0, greatest=60
    )
    lift_time: float = setting(
        1.0, "Lift, straight up to the resting height.", unit="s", least=0.01, greatest=60
    )
    hold_time: float = setting(2.0, "Hold at the resting height.", unit="s", least=0, greatest=600)

    knock_distance: float = setting(
        0.08,
        "An object that moved farther before the lift was knocked away.",
        unit="m",
        least=0,
        greatest=10,
    )
    lift_fraction: float = setting(
        0.5, "Least share of the lift that the object must follow.", least=0, greatest=1
    )
    max_slip: float = setting(
        0.0,
        "Greatest motion of the object in the hand since the lift began; 0: any.",
        unit="m",
        least=0,
        greatest=1,
    )
    max_turn: float = setting(
        0.0,
        "Greatest rotation of the object in the hand since the lift began; 0: any.",
        unit="rad",
        least=0,
        greatest=3.15,
    )
    palm_distance: float = setting(
        0.2,
        "An object whose centre is farther from the palm is not held.",
        unit="m",
        least=0,
        greatest=5,
    )
    lost_time: float = setting(
        0.2,
        "A lifted object without contact for longer is lost.",
        unit="s",
        least=0,
        greatest=60,
    )
    blow_up_speed: float = setting(
        10.0,
        "The simulation has diverged if an object has more kinetic energy per mass than at this "
        "speed.",
        unit="m/s",
        least=0.1,
        greatest=10_000,
    )
