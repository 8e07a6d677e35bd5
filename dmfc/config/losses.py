"""Settings of the losses."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from dmfc.config.setting import setting


@dataclass(frozen=True)
class LossWeights:
    """w1 to w5 of the paper; a term with weight 0 is not computed."""

    chamfer: float = setting(1.0, "w1")
    collision: float = setting(1.0, "w2")
    guidance: float = setting(1.0, "w3")
    q1_upper: float = setting(0.0, "w4")
    confidence: float = setting(1.0, "w5, weight of -log c")


@dataclass(frozen=True)
class Q1Config:
    directions: Literal[64, 728, 4032] = setting(
        64, "directions on the 6-D sphere; more than 64 include nearly pure torques"
    )
    friction: float = setting(0.7, "friction coefficient mu of the cones")
    alpha: float = setting(60.0, "1/m; weight exp(-alpha |d|) of hand points off the surface")
    torque_weight: float = setting(1e-2, "1/m; torque entries of the metric M")
    support: Literal["exact", "published"] = setting(
        "exact", "support function of the friction cone"
    )
    floor: bool = setting(
        True, "a contact may also press less, so Q is at least 0; false keeps a gradient below 0"
    )


@dataclass(frozen=True)
class LossConfig:
    weights: LossWeights = setting(LossWeights, "weights of the terms")
    joint_weight: float = setting(1.0, "weight of the joint angles in the 27-D chamfer distance")
    clamp: Literal["hard", "straight_through", "soft"] = setting(
        "hard", "gradient of the clamp to joint limits"
    )
    length_unit: float = setting(
        1.0, "metres per unit of length in collision and guidance; 0.001 takes them in millimetres"
    )
    self_collision: bool = setting(True, "count the hand's own links among the meshes of collision")
    q1: Q1Config = setting(Q1Config, "the Q1 metric")
