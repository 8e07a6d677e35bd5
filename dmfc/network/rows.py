"""Layers on flat rows `[R, C]`: a point, or a point of a ball, is a row.

A linear layer on rows is a 1x1 convolution without the copies into image layout.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import torch
from torch import Tensor, nn

from dmfc.network.balls import (
    BallLayersFunction,
    NormReluFunction,
    ball_layers,
    norm_relu,
    runs_here,
)


class RowNorm(nn.BatchNorm2d):
    """Batch normalisation of rows `[R, C]` over R.

    Shown to torch as one image of R pixels with the channels last, a view of the same memory: on a
    CPU that path takes half the time of the one for `[R, C]`.
    """

    def forward(self, rows: Tensor) -> Tensor:
        image = rows.view(1, len(rows), 1, -1).permute(0, 3, 1, 2)
        return super().forward(image).permute(0, 2, 3, 1).reshape(rows.shape)

    def with_relu(self, rows: Tensor) -> Tensor:
        """relu(norm(rows))."""
        if runs_here(rows) and self.statistics_known:
            return norm_relu(rows, self.as_affine())
        if runs_here(rows) and self.training:
            out, mean, variance = NormReluFunction.apply(rows, self.weight, self.bias, self.eps)
            self.track(mean, variance, len(rows))
            return out
        return torch.relu(self(rows))

    @property
    def statistics_known(self) -> bool:
        """Whether the norm is a constant scale and shift: evaluation without gradients."""
        return not (self.training or torch.is_grad_enabled() or self.running_var is None)

    @torch.no_grad()
    def as_affine(self) -> tuple[Tensor, Tensor]:
        """The scale and shift `[C]` that the running statistics make of the norm."""
        assert self.running_mean is not None
        assert self.running_var is not None
        scale = self.weight / (self.running_var + self.eps).sqrt()
        return scale, self.bias - scale * self.running_mean

    @torch.no_grad()
    def track(self, mean: Tensor, variance: Tensor, count: int) -> None:
        """Moves the running statistics towards those of `count` rows, as `forward` does."""
        if self.momentum is None or self.running_mean is None or self.running_var is None:
            return
        self.running_mean.lerp_(mean, self.momentum)
        self.running_var.lerp_(variance * (count / (count - 1)), self.momentum)
        if self.num_batches_tracked is not None:
            self.num_batches_tracked += 1


class RowLayers(nn.Sequential):
    """Layers on rows `[R, C]`, where a ReLU follows every norm and is done with it."""

    def forward(self, rows: Tensor) -> Tensor:
        for layer in self:
            if isinstance(layer, RowNorm):
                rows = layer.with_relu(rows)
            elif not isinstance(layer, nn.ReLU):
                rows = layer(rows)
        return rows


def row_layers(widths: Sequence[int]) -> RowLayers:
    """(Linear, norm, ReLU) from each of `widths` to the next; no bias, as the norm has one."""
    layers: list[nn.Module] = []
    for before, after in itertools.pairwise(widths):
        layers += [nn.Linear(before, after, bias=False), RowNorm(after), nn.ReLU()]
    return RowLayers(*layers)


def take_rows(rows: Tensor, index: Tensor, size: int) -> Tensor:
    """Of `rows` `[B*size, C]` those at `index` `[B, ...]` of each cloud: `[index.numel(), C]`."""
    first = torch.arange(len(index), device=index.device) * size
    return rows.index_select(0, (index.flatten(1) + first[:, None]).flatten())


class BallLayers(nn.Module):
    """`row_layers` with the first layer taken apart and the last ReLU left off.

    The first layer of a ball sees (x_j - c_i, f_j). It is linear, so its product with x_j and f_j
    is made once per point j and with c_i once per centre i, not once per pair:
    W [x_j - c_i; f_j] = (W_x x_j + W_f f_j) - W_x c_i.  The ReLU may follow the maximum over the
    ball, because it is monotone: max(relu(h)) = relu(max(h)).
    """

    def __init__(self, in_features: int, widths: Sequence[int]) -> None:
        super().__init__()
        self.from_position = nn.Linear(3, widths[0], bias=False)
        self.from_features = nn.Linear(in_features, widths[0], bias=False) if in_features else None
        hidden: list[nn.Module] = []
        for before, after in itertools.pairwise(widths):
            hidden += [RowNorm(before), nn.ReLU(), nn.Linear(before, after, bias=False)]
        self.rest = nn.Sequential(*hidden, RowNorm(widths[-1]))

    def per_point(self, position: Tensor, features: Tensor | None) -> Tensor:
        """First layer of `position` `[R,3]` and `features` `[R,F]`, before centres are known."""
        rows = self.from_position(position)
        if self.from_features is None or features is None:
            return rows
        return rows + self.from_features(features)

    def of_balls(self, points: Tensor, centres: Tensor, ball: Tensor) -> Tensor:
        """Points `[B*N, C]` and centres `[B*M, C]` after the first layer -> balls `[B*M, C']`.

        `ball` `[B,M,k]` into the N points of each cloud.
        """
        norms = [layer for layer in self.rest if isinstance(layer, RowNorm)]
        if len(norms) > 1 and runs_here(points):
            if norms[0].statistics_known:
                weights = [layer.weight for layer in self.rest if isinstance(layer, nn.Linear)]
                affines = [norm.as_affine() for norm in norms]
                return ball_layers(points, centres, ball, weights, affines)
            if self.training:
                return self._learning(points, centres, ball, norms)
        size = ball.shape[2]
        pairs = take_rows(points, ball, len(points) // len(ball))
        rows = pairs.view(-1, size, points.shape[1]) - centres[:, None]
        return self.pooled(rows.flatten(0, 1), size)

    def _learning(
        self, points: Tensor, centres: Tensor, ball: Tensor, norms: list[RowNorm]
    ) -> Tensor:
        parameters = [p for layer in self.rest for p in layer.parameters()]
        out, *stats = BallLayersFunction.apply(points, centres, ball, norms[0].eps, *parameters)
        for norm, mean, variance in zip(norms, stats[::2], stats[1::2], strict=True):
            norm.track(mean, variance, ball.numel())
        return out

    def pooled(self, rows: Tensor, size: int) -> Tensor:
        """The other layers of `rows` `[R*size, C]` and the maximum of each `size`: `[R, C']`."""
        hidden = self.rest(rows)
        return torch.relu(hidden.view(-1, size, hidden.shape[1]).max(1).values)
