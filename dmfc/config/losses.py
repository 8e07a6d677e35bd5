"""Settings of the losses."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from dmfc.config.setting import KEYS_VERSION, setting

HEAVIEST = 1e6
"""Greatest weight of a term."""


@dataclass(frozen=True)
class LossWeights:
    """Weights of the terms, w1 to w5 of the paper; a term of weight 0 is not computed."""

    chamfer: float = setting(
        1.0, "w1: distance to the label, in grasp space.", least=0, greatest=HEAVIEST
    )
    collision: float = setting(
        1.0, "w2: penetration of hand and objects.", least=0, greatest=HEAVIEST
    )
    guidance: float = setting(
        1.0,
        "w3: distance of the hand's inner points from the object.",
        least=0,
        greatest=HEAVIEST,
    )
    q1_upper: float = setting(
        0.0, "w4: upper bound of the grasp quality Q1.", least=0, greatest=HEAVIEST
    )
    confidence: float = setting(0.2, "w5: -log of the confidence.", least=0, greatest=HEAVIEST)
    q1_lower: float = setting(
        0.0,
        "Weight of exp(-lower bound of Q1), which is not a term of the paper.",
        least=0,
        greatest=HEAVIEST,
    )
    swept: float = setting(
        0.0,
        "Weight of the swept collision: the opened hand on the approach and the closed hand at "
        "the grasp, as execution plans them. Not a term of the paper.",
        least=0,
        greatest=HEAVIEST,
        later=KEYS_VERSION,
    )


@dataclass(frozen=True)
class Q1Config:
    directions: Literal[64, 728, 4032] = setting(
        64, "Directions on the 6-D sphere. More than 64 include nearly pure torques."
    )
    friction: float = setting(
        0.7, "Friction coefficient of the friction cones.", least=0, greatest=10
    )
    alpha: float = setting(
        60.0,
        "Decay of a hand point's weight, exp(-alpha |d|), with its distance d from the surface.",
        unit="1/m",
        least=0,
        greatest=100_000,
    )
    torque_weight: float = setting(
        1e-2,
        "Weight of torques beside forces (the metric M).",
        unit="1/m",
        least=0,
        greatest=100_000,
    )
    floor: bool = setting(
        True,
        "A contact may press less than its full force, so that Q1 is at least 0. False keeps a "
        "gradient below 0.",
    )
    worst: int = setting(
        1,
        "Number of the worst directions whose mean is the upper bound. 1: the minimum, as in the "
        "paper, of which one contact and one direction have a gradient.",
        least=1,
        greatest=64,
        later=KEYS_VERSION,
    )


@dataclass(frozen=True)
class Q1LowerConfig:
    """What the lower bound of Q1 adds to `Q1Config`, whose metric and cones it shares."""

    contacts: int = setting(
        12,
        "Number of contacts that count, those of the largest weights; 0: all.",
        least=0,
        greatest=10_000,
    )
    edges: int = setting(6, "Edges of the pyramid inside each friction cone.", least=3, greatest=64)


@dataclass(frozen=True)
class GuidanceConfig:
    points: Literal["all", "tips"] = setting(
        "all", "Inner points that are drawn: all, as in the paper, or those of the finger tips."
    )
    reach: float = setting(
        0.0,
        "Inner points farther from the surface are not drawn to it; 0: all are.",
        unit="m",
        least=0,
        greatest=1,
    )


@dataclass(frozen=True)
class SweptConfig:
    """The swept collision: what it forbids more strictly than execution does."""

    margin: float = setting(
        0.005,
        "By how much less penetration the opened hand may have on the approach than "
        "execution.approach_tolerance; above that tolerance it is a clearance.",
        unit="m",
        least=0,
        greatest=0.1,
    )
    grasp_tolerance: float = setting(
        0.015,
        "Penetration of the closed hand into its object that costs nothing. Execution refuses "
        "what is beyond execution.grasp_tolerance.",
        unit="m",
        least=0,
        greatest=0.2,
    )


@dataclass(frozen=True)
class GraspSpace:
    """The space of position, rotation and joint angles in which chamfer measures distances."""

    length_unit: float = setting(
        0.05, "Length that counts as 1 in the palm's position.", unit="m", least=1e-4, greatest=100
    )
    joint_weight: float = setting(
        0.25, "Weight of the squared differences of joint angles.", least=0, greatest=HEAVIEST
    )


@dataclass(frozen=True)
class LengthUnits:
    """Length that counts as 1 in each term. The paper names none."""

    collision: float = setting(
        1e-4,
        "Unit of collision, which is a mean over all points and meshes.",
        unit="m",
        least=1e-7,
        greatest=100,
    )
    guidance: float = setting(
        0.3,
        "Unit of guidance, which is a sum over the inner points.",
        unit="m",
        least=1e-7,
        greatest=100,
    )
    swept: float = setting(
        2e-4,
        "Unit of the swept collision, which is a mean over all points and poses.",
        unit="m",
        least=1e-7,
        greatest=100,
        later=KEYS_VERSION,
    )


@dataclass(frozen=True)
class LossConfig:
    weights: LossWeights = setting(LossWeights, "Weights of the terms.")
    grasp_space: GraspSpace = setting(GraspSpace, "The space in which chamfer measures.")
    units: LengthUnits = setting(LengthUnits, "Units of length of collision and guidance.")
    self_collision: bool = setting(
        True, "The collision term also counts penetration of the hand's own links."
    )
    swept: SweptConfig = setting(SweptConfig, "The swept collision.", later=KEYS_VERSION)
    guidance: GuidanceConfig = setting(
        GuidanceConfig, "What guidance draws to the surface.", later=KEYS_VERSION
    )
    relative: bool = setting(
        False,
        "Every term but chamfer counts only beyond its value at the nearest label, so that a "
        "verified grasp costs nothing.",
        later=KEYS_VERSION,
    )
    saturated: bool = setting(
        False,
        "Collision and swept collision count as log(1 + x): a few deep penetrations then do not "
        "outweigh all other predictions.",
        later=KEYS_VERSION,
    )
    q1: Q1Config = setting(Q1Config, "The grasp quality Q1.")
    q1_lower: Q1LowerConfig = setting(Q1LowerConfig, "The lower bound of Q1.")
    custom: dict[str, float] = setting(
        {},
        "Weights of custom loss terms, each a function in a file: {my_losses.py:function: 1}.",
        least=-HEAVIEST,
        greatest=HEAVIEST,
        formerly="own",
    )
