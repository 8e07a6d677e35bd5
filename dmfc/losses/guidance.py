"""Guidance: draws the inside of the hand to the closest surface."""

from __future__ import annotations

from torch import Tensor

from dmfc.objects.atlas import SceneObjects


def guidance(inner_points: Tensor, objects: SceneObjects) -> Tensor:
    """guidance_i = sum_v |p_v - closest surface point|^2 = sum_v min_k d_kv^2, [n] m^2.

    inner_points: [n, V, 3] in the world. All objects of the scene count as one mesh, so each point
    is drawn to whichever is closest.
    """
    return objects.distance(inner_points).square().amin(dim=1).sum(dim=-1)
