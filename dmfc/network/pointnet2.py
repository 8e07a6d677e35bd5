"""PointNet++ in segmentation style (Qi et al. 2017): down to one vector, up to the seed points."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import torch
from torch import Tensor, nn

from dmfc.config.network import NetworkConfig
from dmfc.geometry.points import ball_query, take_points, three_nearest
from dmfc.network.rows import BallLayers, row_layers, take_rows


@dataclass(frozen=True)
class Neighbourhoods:
    """What the network needs to know of a cloud's geometry; made from the points alone.

    positions[l]: `[B, n_l, 3]`, the cloud (l = 0) and each level, metres from the centroid.
    balls[l]: `[B, n_{l+1}, k]` into positions[l]. nearest[l], weights[l]: `[B, n_l, 3]` into
    positions[l+1], from the first level on.
    """

    positions: list[Tensor]
    balls: list[Tensor]
    nearest: list[Tensor]
    weights: list[Tensor]

    @classmethod
    @torch.no_grad()
    def of(cls, centred: Tensor, seed_index: Tensor, config: NetworkConfig) -> Neighbourhoods:
        """From the centred cloud `[B,N,3]` and its farthest points `[B,m]`.

        Farthest points nest, so every deeper level is a prefix of the seeds.
        """
        seeds = take_points(centred, seed_index)
        positions = [centred, *(seeds[:, :count].contiguous() for count in config.levels)]
        pairs = list(itertools.pairwise(positions))
        balls = [
            ball_query(fine, coarse, radius, count)
            for (fine, coarse), radius, count in zip(
                pairs, config.radii, config.neighbours, strict=True
            )
        ]
        near = [three_nearest(coarse, fine) for fine, coarse in pairs[1:]]
        return cls(positions, balls, [n[0] for n in near], [n[1] for n in near])


class SetAbstraction(nn.Module):
    """Features of balls: `[B*N, F]` of the fine points -> `[B*M, C]` of the coarse ones."""

    def __init__(self, in_features: int, widths: list[int], radius: float) -> None:
        super().__init__()
        self.radius = radius
        self.layers = BallLayers(in_features, widths)

    def forward(
        self, fine: Tensor, coarse: Tensor, ball: Tensor, features: Tensor | None
    ) -> Tensor:
        """`fine` `[B,N,3]`, `coarse` `[B,M,3]`, `ball` `[B,M,k]` into `fine`."""
        # in units of the radius: metres would be of the size of the norm's epsilon
        points = self.layers.per_point(fine.reshape(-1, 3) / self.radius, features)
        centres = self.layers.per_point(coarse.reshape(-1, 3) / self.radius, None)
        return self.layers.of_balls(points, centres, ball)


class GlobalAbstraction(nn.Module):
    """One vector per cloud: `[B*M, F]` -> `[B, C]`."""

    def __init__(self, in_features: int, widths: list[int], radius: float) -> None:
        super().__init__()
        self.radius = radius
        self.layers = BallLayers(in_features, widths)

    def forward(self, positions: Tensor, features: Tensor) -> Tensor:
        rows = self.layers.per_point(positions.reshape(-1, 3) / self.radius, features)
        return self.layers.pooled(rows, positions.shape[1])


class FeaturePropagation(nn.Module):
    """Coarse features interpolated at fine points and joined with the fine points' own.

    The first layer acts before the interpolation, on fewer rows: both are linear.
    """

    def __init__(self, coarse_features: int, fine_features: int, widths: list[int]) -> None:
        super().__init__()
        self.from_coarse = nn.Linear(coarse_features, widths[0], bias=False)
        self.from_fine = nn.Linear(fine_features, widths[0], bias=False)
        self.rest = row_layers([widths[0], *widths])[1:]  # the first Linear is the two above

    def forward(
        self, coarse: Tensor, fine: Tensor, nearest: Tensor | None, weights: Tensor | None
    ) -> Tensor:
        """`coarse` `[B*M,F]`, `fine` `[B*N,F']`; nearest, weights `[B,N,3]`, None: M is 1."""
        rows = self.from_coarse(coarse)
        direct = self.from_fine(fine)
        if nearest is None or weights is None:
            joined = direct.view(len(coarse), -1, direct.shape[1]) + rows[:, None]
        else:
            near = take_rows(rows, nearest, len(coarse) // len(nearest)).view(*nearest.shape, -1)
            joined = direct.view(*nearest.shape[:2], -1) + (near * weights[..., None]).sum(2)
        return self.rest(joined.flatten(0, 1))


class PointNet2(nn.Module):
    """Cloud -> `config.features` features per seed point (see `dmfc.network.backbones`)."""

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__()
        self.config = config
        inputs = 1 if config.height_feature else 0
        fine = [inputs, *(widths[-1] for widths in config.abstraction)]
        self.down = nn.ModuleList(
            SetAbstraction(features, widths, radius)
            for features, widths, radius in zip(fine, config.abstraction, config.radii)  # noqa: B905
        )
        self.top = GlobalAbstraction(fine[-1], config.global_widths, 2 * config.radii[-1])
        self.up = nn.ModuleList()
        coarse = config.global_widths[-1]
        for step, widths in enumerate(config.propagation):
            last = step == len(config.propagation) - 1
            layers = [*widths, config.features] if last else widths
            self.up.append(FeaturePropagation(coarse, fine[-1 - step], layers))
            coarse = layers[-1]

    def forward(self, points: Tensor, seed_index: Tensor, height: Tensor | None) -> Tensor:
        geometry = Neighbourhoods.of(points, seed_index, self.config)
        rows = self.rows(geometry, None if height is None else height.reshape(-1, 1))
        return rows.view(*seed_index.shape, -1)

    def rows(self, geometry: Neighbourhoods, features: Tensor | None) -> Tensor:
        """`[B*m, features]`. `features`: `[B*N, 1]` heights where there are some, else None."""
        levels: list[Tensor] = []
        for level, abstraction in enumerate(self.down):
            fine, coarse = geometry.positions[level : level + 2]
            features = abstraction(fine, coarse, geometry.balls[level], features)
            levels.append(features)
        rows = self.top(geometry.positions[-1], levels[-1])
        nearest: list[Tensor | None] = [None, *reversed(geometry.nearest)]
        weights: list[Tensor | None] = [None, *reversed(geometry.weights)]
        for propagation, fine, near, weight in zip(
            self.up, reversed(levels), nearest, weights, strict=True
        ):
            rows = propagation(rows, fine, near, weight)
        return rows
