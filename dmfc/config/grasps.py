"""Settings of the grasp planner (ground truth)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from dmfc.config.setting import GREATEST_SEED, setting


@dataclass(frozen=True)
class GraspsConfig:
    source: Literal["plan", "library", "either"] = setting(
        "either",
        "Where ground-truth grasps come from. 'plan': they are planned; 'library': they are taken "
        "from the library; 'either': they are planned only for objects that the library does not "
        "have.",
    )
    library: str = setting(
        "",
        "Folder of the library, with files HAND/SOURCE__NAME.parquet; empty: the one that is "
        "shipped with dmfc.",
    )
    per_object: int = setting(
        100, "Number of verified grasps wanted per object.", least=1, greatest=100_000
    )
    max_checks: int = setting(
        2000,
        "Candidates of an object simulated in MuJoCo before the planner gives up.",
        least=1,
        greatest=10_000_000,
    )
    batch: int = setting(1024, "Candidates proposed at a time.", least=1, greatest=1_000_000)
    max_batches: int = setting(
        100,
        "Batches proposed for an object before the planner gives up.",
        least=1,
        greatest=1_000_000,
    )
    keep: float = setting(
        0.12,
        "Share of a batch, the best by Q1, that is simulated in MuJoCo.",
        least=1e-6,
        greatest=1,
    )
    surplus: float = setting(
        1.1,
        "Verified grasps per grasp kept. Those kept are chosen far apart.",
        least=1,
        greatest=100,
    )
    seed: int = setting(0, "Seed of the planner.", least=0, greatest=GREATEST_SEED)

    table_share: float = setting(
        1.0,
        "Share of candidates that leave room for a table under a stable pose of the object.",
        least=0,
        greatest=1,
    )
    approach_tilt: float = setting(
        0.25,
        "Standard deviation of the approach direction about the surface normal.",
        unit="rad",
        least=0,
        greatest=3.15,
    )
    straddle_share: float = setting(
        0.8,
        "Share of candidates with thumb and fingers on opposite sides of a narrow width.",
        least=0,
        greatest=1,
    )
    rolls: int = setting(
        4,
        "Number of roll angles among which the narrowest width is chosen. The first is random.",
        least=1,
        greatest=1000,
    )
    finger_reach: float = setting(
        0.08, "How far the fingers reach from the palm.", unit="m", least=0.001, greatest=1
    )
    palm_shift: list[float] = setting(
        [-0.02, 0.04],
        "Range of the target's distance ahead of the palm's centre, towards the fingers.",
        unit="m",
        least=-0.5,
        greatest=0.5,
        length=2,
    )
    palm_gap: list[float] = setting(
        [0.0, 0.03],
        "Range of the gap between palm and target, before the hand backs off.",
        unit="m",
        least=-0.1,
        greatest=0.5,
        length=2,
    )
    back_off: float = setting(
        0.08,
        "How far a hand that does not fit is moved back.",
        unit="m",
        least=0,
        greatest=1,
    )
    back_off_step: float = setting(
        0.004, "Step of this motion.", unit="m", least=1e-4, greatest=0.5
    )
    clearance: float = setting(
        0.001,
        "Gap between the open hand and the object.",
        unit="m",
        least=-0.05,
        greatest=0.05,
    )
    pregrasp_distance: float = setting(
        0.1,
        "Distance of the pre-grasp from the grasp, back along the palm normal.",
        unit="m",
        least=0,
        greatest=1,
        formerly="approach",
    )
    waypoints: int = setting(
        6,
        "Poses of the approach that are checked for collision with the object.",
        least=1,
        greatest=1000,
        formerly="approach_steps",
    )
    approach_tolerance: float = setting(
        0.001,
        "Penetration of the open hand into the object that is allowed on the approach.",
        unit="m",
        least=0,
        greatest=0.1,
        formerly="approach_depth",
    )
    close_range: float = setting(
        1.8,
        "How far a finger closes, as the angle of its first joint.",
        unit="rad",
        least=0.01,
        greatest=6.3,
    )
    close_steps: int = setting(24, "Steps of this motion.", least=1, greatest=10_000)

    seat_gap: list[float] = setting(
        [0.005, 0.05],
        "Range of the gap between palm and target before a fist closes around the object.",
        unit="m",
        least=-0.1,
        greatest=0.5,
        length=2,
    )
    seat_flexion: float = setting(
        1.2,
        "How far a fist closes around the object, which is free to move.",
        unit="rad",
        least=0,
        greatest=6.3,
    )
    seat_time: float = setting(
        0.35, "Time in which the fist closes.", unit="s", least=0.01, greatest=60
    )

    timestep: float = setting(
        0.003,
        "Time step of the planner's simulation, longer than physics.timestep to save time.",
        unit="s",
        least=1e-5,
        greatest=0.02,
    )
    close_time: float = setting(
        0.3, "Time in which the fingers close.", unit="s", least=0.01, greatest=60
    )
    settle_time: float = setting(
        0.15,
        "Time that the released object is held without gravity.",
        unit="s",
        least=0,
        greatest=60,
    )
    gravity_time: float = setting(
        0.15, "Time under gravity in each of six directions.", unit="s", least=0, greatest=60
    )
    lift_height: float = setting(
        0.08,
        "Height of the lift from a table, in the object's stable pose.",
        unit="m",
        least=0,
        greatest=5,
    )
    lift_time: float = setting(0.3, "Duration of the lift.", unit="s", least=0.01, greatest=60)
    lift_hold: float = setting(
        0.15, "Time at the height of the lift.", unit="s", least=0, greatest=60
    )
    max_slip: float = setting(
        0.03,
        "Greatest motion of the object in the hand once it is released.",
        unit="m",
        least=0,
        greatest=1,
    )
    max_gravity_slip: float = setting(
        0.015,
        "Greatest motion of the object in the hand under each direction of gravity.",
        unit="m",
        least=0,
        greatest=1,
    )
    max_turn: float = setting(
        0.7,
        "Greatest rotation of the object in the hand in each of these tests.",
        unit="rad",
        least=0,
        greatest=3.15,
    )
    max_penetration: float = setting(
        0.004,
        "A grasp that penetrates the object deeper is not kept as a label.",
        unit="m",
        least=0,
        greatest=0.1,
    )
    repeats: int = setting(
        2,
        "Perturbed lifts per grasp, which give its robustness.",
        least=0,
        greatest=1000,
    )
    repeat_shift: float = setting(
        0.003,
        "Standard deviation of the palm's position in a perturbed lift.",
        unit="m",
        least=0,
        greatest=0.1,
    )
    repeat_turn: float = setting(
        0.05,
        "Standard deviation of the joint angles in a perturbed lift.",
        unit="rad",
        least=0,
        greatest=1,
    )
    palm_reach: float = setting(
        0.03,
        "A ray from the palm that passes the object within this distance counts as meeting its "
        "nearest point.",
        unit="m",
        least=0,
        greatest=1,
    )
    min_distance: float = setting(
        0.01,
        "Least distance of the palm poses of two labels, where 1 rad counts as 5 cm.",
        unit="m",
        least=0,
        greatest=1,
    )

    def __post_init__(self) -> None:
        """Raises ValueError for a range whose end is below its beginning."""
        for name in ("palm_shift", "palm_gap", "seat_gap"):
            low, high = getattr(self, name)
            if low > high:
                raise ValueError(f"grasps.{name} must be [least, greatest], not {[low, high]}")
