"""Layers on flat rows `[R, C]`: a point, or a point of a ball, is a row.

A linear layer on rows is a 1x1 convolution without the copies into image layout.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import torch
from torch import Tensor, nn


class RowNorm(nn.BatchNorm2d):
    """Batch normalisation of rows `[R, C]` over R.

    Shown to torch as one image of R pixels with the channels last, a view of the same memory: on a
    CPU that path takes half the time of the one for `[R, C]`.
    """

    def forward(self, rows: Tensor) -> Tensor:
        image = rows.view(1, len(rows), 1, -1).permute(0, 3, 1, 2)
        return super().forward(image).permute(0, 2, 3, 1).reshape(rows.shape)


def row_layers(widths: Sequence[int]) -> nn.Sequential:
    """(Linear, norm, ReLU) from each of `widths` to the next; no bias, as the norm has one."""
    layers: list[nn.Module] = []
    for before, after in itertools.pairwise(widths):
        layers += [nn.Linear(before, after, bias=False), RowNorm(after), nn.ReLU()]
    return nn.Sequential(*layers)


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

    def pooled(self, rows: Tensor, size: int) -> Tensor:
        """The other layers of `rows` `[R*size, C]` and the maximum of each `size`: `[R, C']`."""
        hidden = self.rest(rows)
        return torch.relu(hidden.view(-1, size, hidden.shape[1]).max(1).values)
