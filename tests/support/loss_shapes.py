"""Closed-form shapes, and derivatives along a direction, for the tests of the losses."""

from __future__ import annotations

import numpy as np
import torch

BALL, BOX = 0.04, np.array([0.03, 0.05, 0.02])


def ball_distance(points: np.ndarray) -> np.ndarray:
    return BALL - np.linalg.norm(points, axis=-1)


def box_distance(points: np.ndarray) -> np.ndarray:
    excess = np.abs(points) - BOX
    outside = np.linalg.norm(np.maximum(excess, 0), axis=-1)
    return -outside - np.minimum(excess.max(axis=-1), 0)


def slope(function, *inputs: torch.Tensor, seed: int = 0, eps: float = 1e-7) -> tuple[float, float]:
    """Derivative of the sum of `function` along a random direction: by autograd, by differences."""
    generator = torch.Generator().manual_seed(seed)
    ways = [torch.randn(x.shape, generator=generator, dtype=x.dtype) for x in inputs]
    leaves = [x.clone().requires_grad_() for x in inputs]
    gradients = torch.autograd.grad(function(*leaves).sum(), leaves)
    analytic = sum((g * w).sum().item() for g, w in zip(gradients, ways, strict=True))
    moved = [
        function(*(x + sign * eps * w for x, w in zip(inputs, ways, strict=True))).sum().item()
        for sign in (1, -1)
    ]
    return analytic, (moved[0] - moved[1]) / (2 * eps)
