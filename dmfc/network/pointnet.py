"""A tiny PointNet (Qi et al. 2017, CVPR): each seed point alone, and one vector of the cloud.

It sees no neighbourhood. What it lacks against the others is what neighbourhoods are worth.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn

from dmfc.config.network import NetworkConfig
from dmfc.geometry.points import take_points
from dmfc.network.rows import row_layers

UNIT_M = 0.1
"""Positions enter in units of it, so that they are of the size of 1."""


class PointNet(nn.Module):
    """See `dmfc.network.backbones`."""

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__()
        inputs = 4 if config.height_feature else 3
        widths, whole = config.abstraction[0], config.global_widths
        self.local = row_layers([inputs, *widths])
        self.whole = row_layers([widths[-1], *whole])
        self.joined = row_layers([widths[-1] + whole[-1], whole[0], config.features])

    def forward(self, points: Tensor, seed_index: Tensor, height: Tensor | None) -> Tensor:
        inputs = points / UNIT_M
        if height is not None:
            inputs = torch.cat([inputs, height], dim=2)
        batch, count = points.shape[:2]
        local = self.local(inputs.reshape(batch * count, -1)).view(batch, count, -1)
        lifted = self.whole(local.flatten(0, 1)).view(batch, count, -1)
        cloud = lifted.amax(dim=1, keepdim=True).expand(-1, seed_index.shape[1], -1)
        seeds = take_points(local, seed_index)
        rows = torch.cat([seeds, cloud], dim=2).flatten(0, 1)
        return self.joined(rows).view(*seed_index.shape, -1)
