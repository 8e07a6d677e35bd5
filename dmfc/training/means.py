"""Means over an epoch, kept on the device until the epoch ends."""

from __future__ import annotations

from collections.abc import Callable

import torch
from torch import Tensor


class Means:
    """Sums and counts per name. Adding never waits for the device; `result` does, once."""

    def __init__(self) -> None:
        self._sums: dict[str, Tensor] = {}
        self._counts: dict[str, int] = {}

    def add(self, name: str, values: Tensor) -> None:
        """Adds all `values` (any shape, may be empty) to the mean of `name`."""
        total = values.detach().double().sum()
        self._sums[name] = self._sums[name] + total if name in self._sums else total
        self._counts[name] = self._counts.get(name, 0) + values.numel()

    def count(self, name: str) -> int:
        """How many values were added under `name`."""
        return self._counts.get(name, 0)

    def result(self, reduce: Callable[[Tensor], Tensor]) -> dict[str, float]:
        """The mean of each name with values; `reduce` adds a tensor up over all processes."""
        names = sorted(self._sums)
        if not names:
            return {}
        sums = torch.stack([self._sums[name] for name in names])
        counts = torch.tensor(
            [self._counts[name] for name in names], dtype=torch.float64, device=sums.device
        )
        sums, counts = reduce(sums), reduce(counts)
        means = (sums / counts).tolist()
        return {n: m for n, m, c in zip(names, means, counts.tolist(), strict=True) if c > 0}
