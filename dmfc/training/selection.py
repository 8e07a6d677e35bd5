"""Hard example mining: which predictions are back-propagated."""

from __future__ import annotations

import torch
from torch import Tensor


def hardest(error: Tensor, scene: Tensor, count: int, scope: str = "batch") -> Tensor:
    """Indices of the `count` highest of `error` `[n]`, highest first, lower index first on ties.

    `scope` 'batch': of all; 'scene': of each scene, where `scene` `[n]` tells whose each is. A
    `count` of 0 takes all. An error that is not finite counts as the highest, so that it is seen.
    """
    key = torch.nan_to_num(error.detach(), nan=torch.inf)
    order = key.sort(descending=True, stable=True).indices
    if count == 0:
        return order
    if scope == "batch":
        return order[:count]
    grouped = order[scene[order].sort(stable=True).indices]
    first = torch.searchsorted(scene[grouped].contiguous(), scene[grouped].contiguous())
    place = torch.arange(len(grouped), device=error.device) - first  # rank within its scene
    return grouped[place < count]
