"""The network of an outcome predictor: a few small ones side by side, and their calibration."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import torch
from torch import Tensor, nn
from torch.nn.functional import silu

CLIP = 5.0
"""Standard deviations beyond which a feature is no farther."""


class OutcomeNet(nn.Module):
    """M networks with two logits each: planned, and held where it was planned."""

    mean: Tensor
    scale: Tensor
    slope: Tensor
    shift: Tensor

    def __init__(
        self, features: int, widths: Sequence[int], members: int, dropout: float = 0.0
    ) -> None:
        super().__init__()
        self.members, self.dropout = members, dropout
        sizes = [features, *widths, 2]
        self.weights = nn.ParameterList(
            nn.Parameter(torch.randn(members, a, b) * a**-0.5) for a, b in pairwise(sizes)
        )
        self.biases = nn.ParameterList(nn.Parameter(torch.zeros(members, 1, b)) for b in sizes[1:])
        self.register_buffer("mean", torch.zeros(features))
        self.register_buffer("scale", torch.ones(features))
        self.register_buffer("slope", torch.ones(2))
        self.register_buffer("shift", torch.zeros(2))

    def normalise(self, features: Tensor) -> Tensor:
        """[n, F] -> [n, F] with the training trials' mean 0 and deviation 1; not known: 0."""
        normal = ((features - self.mean) / self.scale).clamp(-CLIP, CLIP)
        return torch.nan_to_num(normal, nan=0.0)

    def logits(self, normal: Tensor) -> Tensor:
        """[M, n, 2] of normalised features [n, F], or [M, n, F], before calibration."""
        rows = normal if normal.dim() == 3 else normal.expand(self.members, *normal.shape)
        last = len(self.weights) - 1
        for k, (weight, bias) in enumerate(zip(self.weights, self.biases, strict=True)):
            rows = torch.baddbmm(bias, rows, weight)
            if k < last:
                rows = nn.functional.dropout(silu(rows), self.dropout, self.training)
        return rows

    def forward(self, features: Tensor) -> Tensor:
        """Calibrated probabilities [n, 2]: planned, and held where it was planned."""
        mean = self.logits(self.normalise(features)).mean(0)
        return torch.sigmoid(self.slope * mean + self.shift)
