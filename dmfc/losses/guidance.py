"""Guidance: draws the inside of the hand to the closest surface."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from dmfc.hand.model import HandModel
from dmfc.objects.atlas import SceneObjects


def guidance(inner_points: Tensor, objects: SceneObjects, reach: float = 0.0) -> Tensor:
    """guidance_i = sum_v |p_v - closest surface point|^2 = sum_v min_k d_kv^2, [n] m^2.

    inner_points: [n, V, 3] in the world. All objects of the scene count as one mesh, so each point
    is drawn to whichever is closest. A point beyond `reach` metres counts reach^2 and is not drawn;
    0: all are.
    """
    squared = objects.distance(inner_points).square().amin(dim=1)
    return (squared.clamp(max=reach**2) if reach > 0 else squared).sum(dim=-1)


def tips(hand: HandModel) -> Tensor:
    """Rows [t] of the inner points on links that no other link turns on."""
    return torch.from_numpy(np.flatnonzero(~np.isin(hand.inner_link, hand.parents)))
