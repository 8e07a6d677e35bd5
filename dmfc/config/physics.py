"""Settings of the simulated physics, shared by the planner's check and by execution."""

from __future__ import annotations

from dataclasses import dataclass

from dmfc.config.setting import setting


@dataclass(frozen=True)
class PhysicsConfig:
    timestep: float = setting(
        0.002,
        "Time step of the simulation. Contacts of a cup of 13 g diverge above 4 ms.",
        unit="s",
        least=1e-5,
        greatest=0.02,
    )
    hand_friction: float = setting(
        1.0,
        "Sliding friction of the hand (polyurethane tips). The larger coefficient of the two "
        "surfaces counts.",
        least=0,
        greatest=10,
    )
    object_friction: float = setting(
        0.5, "Sliding friction of objects and table on each other.", least=0, greatest=10
    )
    torsional_friction: float = setting(
        0.005, "Torsional friction of every contact (soft finger).", unit="m", least=0, greatest=1
    )
    rolling_friction: float = setting(
        0.0005, "Rolling friction of a ball on the table.", unit="m", least=0, greatest=1
    )
    impratio: float = setting(
        100.0,
        "Ratio of friction stiffness to normal stiffness. With a low ratio objects creep out of "
        "the hand.",
        least=0.1,
        greatest=10_000,
    )
    noslip_iterations: int = setting(
        0, "Iterations of MuJoCo's no-slip post-processing.", least=0, greatest=1000
    )
    gain_scale: float = setting(
        5.0,
        "Factor on the finger gains of the hand's MJCF, which are too soft to hold an object. "
        "The torque limits of the MJCF stay.",
        least=0.01,
        greatest=1000,
    )
    base_mass: float = setting(
        1.0, "Mass added to the palm for the arm that carries it.", unit="kg", least=0, greatest=100
    )
    contact_time: float = setting(
        0.005,
        "Time constant of contacts of objects and table (MuJoCo's solref).",
        unit="s",
        least=1e-4,
        greatest=1,
    )
    hand_weight: bool = setting(True, "Gravity acts on the hand. It always acts on the objects.")
    object_mass: float = setting(
        0.0, "Mass of every object; 0: each object's own mass.", unit="kg", least=0, greatest=100
    )
    actuator_gain: float = setting(
        0.0,
        "Gain of every finger actuator; 0: the gain of the MJCF times gain_scale.",
        unit="N m/rad",
        least=0,
        greatest=10_000,
    )
    actuator_limit: float = setting(
        0.0,
        "Torque limit of every finger actuator; 0: the limit of the MJCF.",
        unit="N m",
        least=0,
        greatest=10_000,
    )
