"""Settings of the grasp planner (ground truth)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from dmfc.config.setting import setting


@dataclass(frozen=True)
class GraspsConfig:
    source: Literal["plan", "library", "either"] = setting(
        "plan",
        "plan the grasps, take those of the library, or plan only what it lacks",
    )
    library: str = setting(
        "", "folder of grasp sets HAND/SOURCE__NAME.parquet; empty: the package's", later=True
    )
    per_object: int = setting(100, "verified grasps wanted per object")
    max_checks: int = setting(2000, "checks in MuJoCo per object before the planner gives up")
    batch: int = setting(1024, "candidates proposed at a time")
    max_batches: int = setting(100, "batches proposed per object before the planner gives up")
    keep: float = setting(0.12, "share of a batch, the best by Q1, that is checked in MuJoCo")
    surplus: float = setting(1.1, "grasps found per grasp kept; those kept are spread apart")
    seed: int = setting(0, "seed of the planner")

    table_share: float = setting(
        1.0, "share of candidates that leave room for a table under a stable pose of the object"
    )
    approach_tilt: float = setting(0.25, "spread of the approach about the surface normal")
    straddle_share: float = setting(
        0.8, "share of candidates that put thumb and fingers on both sides of a narrow width"
    )
    rolls: int = setting(4, "rolls among which the narrowest width is taken; the first is random")
    finger_reach: float = setting(0.08, "how deep the fingers reach from the palm, metres")
    palm_shift: list[float] = setting([-0.02, 0.04], "target ahead of the palm's centre, metres")
    palm_gap: list[float] = setting([0.0, 0.03], "palm to target before backing off, metres")
    back_off: float = setting(0.08, "farthest retreat of a hand that does not fit, metres")
    back_off_step: float = setting(0.004, "step of the retreat, metres")
    clearance: float = setting(0.001, "gap between the open hand and the object, metres")
    approach: float = setting(0.1, "way along the palm normal that the open hand comes, metres")
    approach_steps: int = setting(6, "poses of it that are checked against the object")
    approach_depth: float = setting(0.001, "penetration that is allowed there, metres")
    close_range: float = setting(1.8, "farthest closing of a finger, rad of its first joint")
    close_steps: int = setting(24, "steps of the closing")

    seat_gap: list[float] = setting([0.005, 0.05], "palm to target before a fist closes, metres")
    seat_flexion: float = setting(1.2, "rad that a fist closes around the object, left free")
    seat_time: float = setting(0.35, "s, to close it")

    timestep: float = setting(0.003, "s, of the checks; longer than physics.timestep, to save time")
    close_time: float = setting(0.3, "s, fingers close")
    settle_time: float = setting(0.15, "s, released, without gravity")
    gravity_time: float = setting(0.15, "s in each of the six directions")
    lift_height: float = setting(0.08, "metres, lift from the table in the stable pose")
    lift_time: float = setting(0.3, "s")
    lift_hold: float = setting(0.15, "s at that height")
    max_slip: float = setting(0.03, "metres that the object may move in the hand once released")
    max_gravity_slip: float = setting(0.015, "metres that each direction of gravity may move it")
    max_turn: float = setting(0.7, "rad that the object may turn in the hand at each of these")
    max_penetration: float = setting(0.004, "metres; a label that presses deeper is dropped")
    repeats: int = setting(2, "perturbed lifts per grasp kept, for the robustness score")
    repeat_shift: float = setting(0.003, "metres, spread of the palm in a repeat")
    repeat_turn: float = setting(0.05, "rad, spread of the joints in a repeat")
    palm_reach: float = setting(
        0.03, "a palm ray that passes the object within this meets its nearest point, metres"
    )
    min_distance: float = setting(0.01, "palm-pose distance of two labels, metres (1 rad = 5 cm)")
