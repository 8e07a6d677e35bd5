"""DGCNN (Wang et al. 2019): edge convolutions on graphs of nearest neighbours in feature space.

Each point i has an edge to its k nearest points j, in space at first and then among the features of
the layer before. An edge carries (x_i, x_j - x_i), and a point the maximum over its edges. As the
seed points are what grasps are wanted of, the graph is that of the seeds; the first layer takes in
all points of the cloud around them.
"""

from __future__ import annotations

import itertools

import torch
from torch import Tensor, nn

from dmfc.config.network import NetworkConfig
from dmfc.geometry.points import take_points
from dmfc.network.pointnet import UNIT_M
from dmfc.network.rows import row_layers


class EdgeConvolution(nn.Module):
    """max_j layers(x_i, x_j - x_i) over the k nearest j."""

    def __init__(self, inputs: int, outputs: int, neighbours: int) -> None:
        super().__init__()
        self.neighbours = neighbours
        self.layers = row_layers([2 * inputs, outputs])

    def forward(self, at: Tensor, among: Tensor) -> Tensor:
        """Features `[B,m,C]` of the points, among those `[B,n,C]` of others -> `[B,m,C']`."""
        k = min(self.neighbours, among.shape[1])
        near = torch.cdist(at, among).topk(k, dim=2, largest=False).indices
        picked = take_points(among, near.flatten(1)).view(*near.shape, -1)
        own = at[:, :, None].expand_as(picked)
        edges = torch.cat([own, picked - own], dim=3).flatten(0, 2)
        return self.layers(edges).view(*near.shape, -1).amax(dim=2)


class Dgcnn(nn.Module):
    """See `dmfc.network.backbones`. An edge convolution per `config.abstraction`, of its last width
    and `config.neighbours[0]` edges; then all of them, and one vector of the cloud."""

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__()
        widths = [4 if config.height_feature else 3]
        widths += [layers[-1] for layers in config.abstraction]
        self.edges = nn.ModuleList(
            EdgeConvolution(before, after, config.neighbours[0])
            for before, after in itertools.pairwise(widths)
        )
        joined, whole = sum(widths[1:]), config.global_widths[-1]
        self.whole = row_layers([joined, whole])
        self.joined = row_layers([joined + whole, *config.propagation[-1], config.features])

    def forward(self, points: Tensor, seed_index: Tensor, height: Tensor | None) -> Tensor:
        inputs = points / UNIT_M
        if height is not None:
            inputs = torch.cat([inputs, height], dim=2)
        features = take_points(inputs, seed_index)
        among, levels = inputs, []
        for convolution in self.edges:
            features = convolution(features, among)
            among = features
            levels.append(features)
        local = torch.cat(levels, dim=2)
        lifted = self.whole(local.flatten(0, 1)).view(*seed_index.shape, -1)
        cloud = lifted.amax(dim=1, keepdim=True).expand_as(lifted)
        rows = torch.cat([local, cloud], dim=2).flatten(0, 1)
        return self.joined(rows).view(*seed_index.shape, -1)
