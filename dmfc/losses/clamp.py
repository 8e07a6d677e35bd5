"""Joint angles held within the hand's limits before kinematics, with a choice of gradients."""

from __future__ import annotations

from typing import Literal

import torch
from torch import Tensor
from torch.nn.functional import softplus

SOFTNESS = 0.02
"""Radians; how far from a limit the soft clamp begins to bend."""


def clamp_joints(
    joints: Tensor,
    lower: Tensor,
    upper: Tensor,
    mode: Literal["hard", "straight_through", "soft"] = "hard",
) -> Tensor:
    """Joints [..., J] within lower..upper [J], rad.

    hard: no gradient beyond a limit. straight_through: the same values, gradient 1 everywhere.
    soft: l + s softplus((q - l) / s) - s softplus((q - u) / s), smooth, its gradient small but
    alive beyond a limit; inside it differs from q by at most s log 2.
    """
    if mode == "hard":
        return torch.clamp(joints, lower, upper)
    if mode == "straight_through":
        return joints + (torch.clamp(joints, lower, upper) - joints).detach()
    above = SOFTNESS * softplus((joints - lower) / SOFTNESS)
    return lower + above - SOFTNESS * softplus((joints - upper) / SOFTNESS)
