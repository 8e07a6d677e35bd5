"""The network as published ports of PointNet++ write it: the yardstick of speed and of parity.

Grouped tensors in image layout with 1x1 convolutions, a Python loop for farthest points, sorting
for balls and neighbours. It takes its weights from `DmfcGraspNet`, so that both must agree.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn

from dmfc.network.model import DmfcGraspNet
from dmfc.network.pointnet2 import FeaturePropagation
from dmfc.network.rows import BallLayers


def square_distance(a: Tensor, b: Tensor) -> Tensor:
    """`[B,M,N]` between `[B,M,3]` and `[B,N,3]`."""
    return ((a[:, :, None] - b[:, None]) ** 2).sum(-1)


def index_points(values: Tensor, index: Tensor) -> Tensor:
    batch = torch.arange(len(values)).view(-1, *[1] * (index.ndim - 1)).expand_as(index)
    return values[batch, index]


def farthest_point_sample(points: Tensor, count: int) -> Tensor:
    size, cloud = points.shape[:2]
    chosen = torch.zeros(size, count, dtype=torch.long)
    distance = torch.full((size, cloud), 1e10, dtype=points.dtype)
    farthest = torch.zeros(size, dtype=torch.long)
    for i in range(count):
        chosen[:, i] = farthest
        centre = points[torch.arange(size), farthest][:, None]
        distance = torch.minimum(distance, ((points - centre) ** 2).sum(-1))
        farthest = distance.max(-1).indices
    return chosen


def query_ball(radius: float, count: int, points: Tensor, centres: Tensor) -> Tensor:
    size = points.shape[1]
    index = torch.arange(size).expand(len(points), centres.shape[1], size).clone()
    index[square_distance(centres, points) >= radius**2] = size
    index = index.sort(-1).values[..., :count]
    first = index[..., :1].expand_as(index)
    return torch.where(index == size, first, index)


def conv(linear: nn.Linear, norm: nn.BatchNorm2d) -> list[nn.Module]:
    """Convolution, norm and ReLU with the weights of `linear` and `norm`."""
    layer = nn.Conv2d(
        linear.in_features, linear.out_features, 1, bias=False, dtype=linear.weight.dtype
    )
    layer.weight.data = linear.weight.data[:, :, None, None].clone()
    copy = nn.BatchNorm2d(norm.num_features, dtype=linear.weight.dtype)
    copy.load_state_dict(norm.state_dict())
    return [layer, copy, nn.ReLU()]


def joined(*parts: nn.Linear | None) -> nn.Linear:
    """One linear layer for the concatenation of what `parts` act on."""
    weights = [part.weight.data for part in parts if part is not None]
    weight = torch.cat(weights, 1)
    layer = nn.Linear(weight.shape[1], weight.shape[0], bias=False, dtype=weight.dtype)
    layer.weight.data = weight
    return layer


def convolutions(first: nn.Linear, rest: nn.Sequential) -> nn.Sequential:
    linears = [first, *(m for m in rest if isinstance(m, nn.Linear))]
    norms = [m for m in rest if isinstance(m, nn.BatchNorm2d)]
    layers = [m for pair in zip(linears, norms, strict=True) for m in conv(*pair)]
    return nn.Sequential(*layers)


def ball_convolutions(layers: BallLayers) -> nn.Sequential:
    return convolutions(joined(layers.from_position, layers.from_features), layers.rest)


def up_convolutions(layers: FeaturePropagation) -> nn.Sequential:
    return convolutions(joined(layers.from_coarse, layers.from_fine), layers.rest)


class ReferenceNet(nn.Module):
    """`forward(points)` -> offset, rotation6d, joints, logit as in `dmfc.network.Prediction`."""

    def __init__(self, net: DmfcGraspNet) -> None:
        super().__init__()
        self.config = net.config
        self.down = nn.ModuleList(ball_convolutions(a.layers) for a in net.backbone.down)
        self.top = ball_convolutions(net.backbone.top.layers)
        self.up = nn.ModuleList(up_convolutions(p) for p in net.backbone.up)
        self.heads = nn.ModuleList()
        for head in (net.offset_head, net.rotation_head, net.joints_head, net.confidence_head):
            layers = convolutions(head[0], head[1:-1])
            last = nn.Conv2d(head[-1].in_features, head[-1].out_features, 1)
            last = last.to(head[-1].weight.dtype)
            last.weight.data = head[-1].weight.data[:, :, None, None].clone()
            last.bias.data = head[-1].bias.data.clone()
            self.heads.append(nn.Sequential(*layers, last))

    def forward(self, points: Tensor) -> list[Tensor]:
        config = self.config
        positions, features = [points - points.mean(1, keepdim=True)], [None]
        for mlp, count, radius, size in zip(
            self.down, config.levels, config.radii, config.neighbours, strict=True
        ):
            fine = positions[-1]
            coarse = index_points(fine, farthest_point_sample(fine, count))
            index = query_ball(radius, size, fine, coarse)
            group = (index_points(fine, index) - coarse[:, :, None]) / radius
            if features[-1] is not None:
                group = torch.cat([group, index_points(features[-1], index)], -1)
            rows = mlp(group.permute(0, 3, 2, 1))  # [B, C, k, M]
            positions.append(coarse)
            features.append(rows.max(2).values.transpose(1, 2))
        rows = torch.cat([positions[-1] / (2 * config.radii[-1]), features[-1]], -1)
        top = self.top(rows.transpose(1, 2)[..., None]).max(2).values.transpose(1, 2)
        return self.heads_of(self.upward(positions, features, top))

    def upward(self, positions: list[Tensor], features: list[Tensor], rows: Tensor) -> Tensor:
        coarse = None
        for mlp, fine, own in zip(self.up, positions[:0:-1], features[:0:-1], strict=True):
            if coarse is None:
                spread = rows.expand(-1, fine.shape[1], -1)
            else:
                distance, index = square_distance(fine, coarse).sort(-1)
                weight = 1 / distance[..., :3].clamp_min(1e-10)
                weight = weight / weight.sum(-1, keepdim=True)
                spread = (index_points(rows, index[..., :3]) * weight[..., None]).sum(2)
            both = torch.cat([spread, own], -1).transpose(1, 2)[..., None]
            rows = mlp(both).squeeze(-1).transpose(1, 2)
            coarse = fine
        return rows

    def heads_of(self, rows: Tensor) -> list[Tensor]:
        image = rows.transpose(1, 2)[..., None]
        return [head(image).squeeze(-1).transpose(1, 2) for head in self.heads]
