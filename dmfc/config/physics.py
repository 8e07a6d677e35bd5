"""Settings of the simulated physics, shared by the planner's check and by execution."""

from __future__ import annotations

from dataclasses import dataclass

from dmfc.config.setting import setting


@dataclass(frozen=True)
class PhysicsConfig:
    timestep: float = setting(0.002, "s; contacts of a 13 g cup blow up above 4 ms")
    hand_friction: float = setting(
        1.0, "sliding friction of the hand (polyurethane tips); of two surfaces the larger counts"
    )
    object_friction: float = setting(0.5, "sliding friction of objects and table on each other")
    torsional_friction: float = setting(0.005, "metres, of every contact (soft finger)")
    rolling_friction: float = setting(0.0005, "metres, of a ball on the table")
    impratio: float = setting(100.0, "friction stiffness over normal; grasps creep if it is low")
    noslip_iterations: int = setting(0, "passes of the no-slip post-processing")
    gain_scale: float = setting(
        5.0, "finger gains over the MJCF's, too soft to squeeze; its torque limits stay"
    )
    base_mass: float = setting(1.0, "kg added to the palm for what carries it")
    contact_time: float = setting(
        0.005, "s, time constant of contacts of objects and table (MuJoCo's solref)"
    )
    hand_weight: bool = setting(True, "gravity acts on the hand too; on objects it always does")
    object_mass: float = setting(0.0, "kg of every object; 0: each its own")
    actuator_gain: float = setting(
        0.0, "N m/rad of every finger actuator; 0: the MJCF's times gain_scale"
    )
    actuator_limit: float = setting(0.0, "N m, torque limit of every actuator; 0: the MJCF's")
