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
    q1_lower: float = setting(0.0, "weight of exp(-lower bound of Q1); not a term of the paper")


@dataclass(frozen=True)
class Q1Config:
    directions: Literal[64, 728, 4032] = setting(
        64, "directions on the 6-D sphere; more than 64 include nearly pure torques"
    )
    friction: float = setting(0.7, "friction coefficient mu of the cones")
    alpha: float = setting(60.0, "1/m; weight exp(-alpha |d|) of hand points off the surface")
    torque_weight: float = setting(1e-2, "1/m; torque entries of the metric M")
    floor: bool = setting(
        True, "a contact may also press less, so Q is at least 0; false keeps a gradient below 0"
    )


@dataclass(frozen=True)
class Q1LowerConfig:
    """What the lower bound of Q1 adds to `Q1Config`, whose metric and cones it shares."""

    contacts: int = setting(12, "contacts of the largest weights that are counted; 0: all")
    edges: int = setting(6, "edges of the pyramid inside each friction cone")

    def __post_init__(self) -> None:
        """Raises ValueError for a pyramid without volume."""
        if self.edges < 3 or self.contacts < 0:
            raise ValueError("losses.q1_lower: edges must be at least 3, contacts not negative")


@dataclass(frozen=True)
class GraspSpace:
    """The 27-D space in which chamfer measures distances."""

    length_unit: float = setting(0.1, "metres per unit of the palm's position")
    joint_weight: float = setting(1.0, "weight of the squared differences of joint angles")

    def __post_init__(self) -> None:
        """Raises ValueError for a unit of no length or a negative weight."""
        if self.length_unit <= 0 or self.joint_weight < 0:
            raise ValueError(
                "losses.grasp_space: length_unit must be positive, joint_weight not negative"
            )


@dataclass(frozen=True)
class LengthUnits:
    """Metres per unit of length. The paper names none; these make each term of the order of 1."""

    collision: float = setting(1e-4, "of collision, a mean over all points and meshes")
    guidance: float = setting(0.1, "of guidance, a sum over the inner points")

    def __post_init__(self) -> None:
        """Raises ValueError for a unit of no length."""
        if min(self.collision, self.guidance) <= 0:
            raise ValueError("losses.units: collision and guidance must be positive")


@dataclass(frozen=True)
class LossConfig:
    weights: LossWeights = setting(LossWeights, "weights of the terms")
    grasp_space: GraspSpace = setting(GraspSpace, "the space of chamfer")
    units: LengthUnits = setting(LengthUnits, "units of length of the terms in squared lengths")
    self_collision: bool = setting(True, "count the hand's own links among the meshes of collision")
    q1: Q1Config = setting(Q1Config, "the Q1 metric")
    q1_lower: Q1LowerConfig = setting(Q1LowerConfig, "its lower bound")
    own: dict[str, float] = setting(
        {}, "weights of terms of your own: {my_losses.py:function: 1}", later=True
    )
