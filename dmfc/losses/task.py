"""The terms of the task loss that need the hand and the scene, and their weighted sum."""

from __future__ import annotations

from collections.abc import Collection, Mapping

import torch
from torch import Tensor

from dmfc.config.execution import ExecutionConfig
from dmfc.config.losses import LossConfig, LossWeights
from dmfc.errors import unknown_name
from dmfc.geometry.transforms import transform
from dmfc.hand.approach import Approach
from dmfc.hand.kinematics import HandKinematics
from dmfc.hand.model import HandModel
from dmfc.losses.collision import SelfCollision, collision
from dmfc.losses.custom import CustomTerms, PlacedHands
from dmfc.losses.guidance import guidance, tips
from dmfc.losses.q1 import grasp_contacts, q1_of_contacts
from dmfc.losses.q1_lower import q1_lower_of_contacts
from dmfc.losses.swept import SweptCollision
from dmfc.objects.atlas import SceneObjects

TERMS = ("chamfer", "collision", "guidance", "q1_upper", "q1_lower", "swept")
"""The terms of the task loss: w1 to w4 of the paper, then ours."""
Q1_TERMS = {"q1_upper", "q1_lower"}


def active_terms(weights: LossWeights) -> list[str]:
    """The terms whose weight is not 0."""
    return [name for name in TERMS if getattr(weights, name) != 0]


def weighted_sum(
    terms: Mapping[str, Tensor], weights: LossWeights, custom: Mapping[str, float] | None = None
) -> Tensor:
    """task_i = sum over the given terms of weight * term_i, [n].

    `custom`: weights of the user's terms by their names. Raises DmfcError for a term that has no
    weight, ValueError without a term.
    """
    if not terms:
        raise ValueError("a task loss needs a term")
    known = {name: getattr(weights, name) for name in TERMS} | dict(custom or {})
    for name in terms:
        if name not in known:
            raise unknown_name("loss", name, known)
    return torch.stack([known[name] * value for name, value in terms.items()]).sum(0)


class SceneTerms:
    """Collision, guidance, Q1 and custom terms of grasps of one hand."""

    def __init__(
        self, hand: HandModel, config: LossConfig, approach: Approach | None = None
    ) -> None:
        """`approach`: what is swept (None: that of execution by default)."""
        self.config = config
        self.kinematics = HandKinematics(hand)
        way = approach or Approach.of_execution(ExecutionConfig())
        self.swept = SweptCollision(self.kinematics, config.swept, way)
        self.self_collision = SelfCollision(hand) if config.self_collision else None
        self.tips = tips(hand) if config.guidance.points == "tips" else None
        self.custom = CustomTerms(config.custom)

    def __call__(
        self,
        position: Tensor,
        rotation: Tensor,
        joints: Tensor,
        objects: SceneObjects,
        names: Collection[str],
    ) -> dict[str, Tensor]:
        """Those of the terms `names` that this computes, [n] each, not weighted.

        position [n, 3] and rotation [n, 3, 3] of the palm in the world; joints [n, J] rad, as
        predicted: they are clamped here; objects: those around each grasp. q1_upper, q1_lower are
        exp(-Q).
        """
        held = self.kinematics.clamp(joints)
        T_world_link = self.kinematics.links(transform(rotation, position), held)
        hands = PlacedHands(position, rotation, held, T_world_link, objects, self.kinematics)
        terms: dict[str, Tensor] = {}
        if "collision" in names:
            value = collision(hands.points, objects, T_world_link, self.self_collision)
            terms["collision"] = self._bounded(value / self.config.units.collision**2)
        if "swept" in names:
            value = self.swept(position, rotation, held, objects)
            terms["swept"] = self._bounded(value / self.config.units.swept**2)
        if "guidance" in names:
            inner = hands.inner if self.tips is None else hands.inner[:, self.tips]
            value = guidance(inner, objects, self.config.guidance.reach)
            terms["guidance"] = value / self.config.units.guidance**2
        if Q1_TERMS & set(names):
            q1 = self.config.q1
            contacts = grasp_contacts(hands.inner, objects, q1)
            if "q1_upper" in names:
                terms["q1_upper"] = torch.exp(-q1_of_contacts(*contacts, q1))
            if "q1_lower" in names:
                lower = q1_lower_of_contacts(*contacts, q1, self.config.q1_lower)
                terms["q1_lower"] = torch.exp(-lower)
        for name in self.custom.names:
            if name in names:
                terms[name] = self.custom(name, hands)
        return terms

    def _bounded(self, penetration: Tensor) -> Tensor:
        """A term of penetration as the settings want it: as it is, or log(1 + x)."""
        return torch.log1p(penetration) if self.config.saturated else penetration
