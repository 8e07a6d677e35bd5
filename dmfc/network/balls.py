"""The layers of a set abstraction on a CPU: linear, norm and ReLU on the points of balls, maximum.

Equal to the same layers written with torch's operations, with three savings:

1.  A ball with fewer points than places is padded with its first point. That point's row is
    computed once and counted as often as it is there in means, variances and gradients.
2.  The last layer's rows y = W x are not kept: of them the maximum, the mean and the variance are.
3.  The gradient of the last norm is sparse but for its terms in mean and variance. With g the
    gradient at the maxima, n how often a row counts and R all of them,
    dy = s g - n (a + b y),  s = gamma / sigma,  b = s sum(g y^) / (R sigma),
    a = s sum(g) / R - b mean,  and as y = W x the dense part of dx is -n (aW + x (W^T diag(b) W)):
    a product with a matrix of the narrower layer, as is the dense part of dW,
    -(a sum(n x) + diag(b) W sum(n x x^T)).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor

from dmfc.geometry.compiled import compiled_loops
from dmfc.network import ball_kernels as kernels

CHUNK_NUMBERS = 2**17
"""Numbers of the last layer made at once, so that they are pooled before they leave the cache."""


def runs_here(rows: Tensor) -> bool:
    """Whether the functions here take `rows`: on a CPU, in float32 or float64."""
    known = rows.device.type == "cpu" and rows.dtype in (torch.float32, torch.float64)
    return known and compiled_loops()


class Norm(NamedTuple):
    """y -> scale y + shift is the norm. mean, variance `[C]` are biased, over all rows."""

    mean: Tensor
    variance: Tensor
    scale: Tensor
    shift: Tensor
    deviation: Tensor

    @classmethod
    def of(cls, sums: np.ndarray, count: int, gamma: Tensor, beta: Tensor, eps: float) -> Norm:
        mean, square = torch.from_numpy(sums) / count
        variance = (square - mean.square()).clamp_min(0)
        deviation = (variance + eps).sqrt()
        scale = gamma / deviation
        values = (mean, variance, scale, beta - scale * mean, deviation)
        return cls(*(value.to(gamma.dtype) for value in values))

    def backward(self, sums: np.ndarray, count: int) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """Gradients of gamma and beta, then `a` and `b` (see above), from sums of g and g y."""
        plain, with_y = torch.from_numpy(sums)
        normed = (with_y - self.mean * plain) / self.deviation
        slope = self.scale * normed / (count * self.deviation)
        constant = self.scale * plain / count - slope * self.mean
        values = (normed, plain, constant, slope)
        gamma, beta, a, b = (value.to(self.mean.dtype) for value in values)
        return gamma, beta, a, b


class BallLayersFunction(torch.autograd.Function):
    """Points, centres, balls, epsilon and parameters -> pooled rows, mean and variance per norm."""

    @staticmethod
    def forward(
        ctx: Any, points: Tensor, centres: Tensor, ball: Tensor, eps: float, *parameters: Tensor
    ) -> tuple[Tensor, ...]:
        weights, gammas, betas = _parameters(parameters)
        size = ball.shape[-1]
        source, starts = kernels.compact(ball.numpy(), len(points) // len(ball))
        count = (len(starts) - 1) * size
        p, c = points.numpy(), centres.numpy()
        sums = kernels.pair_sums(p, c, source, starts, size)
        norms = [Norm.of(sums, count, gammas[0], betas[0], eps)]
        x = points.new_empty(len(source), points.shape[1])
        scale, shift = norms[0].scale.numpy(), norms[0].shift.numpy()
        kernels.activate_pairs(p, c, source, starts, scale, shift, x.numpy())
        inputs, hidden = [x], []
        for weight, gamma, beta in zip(weights[:-1], gammas[1:-1], betas[1:-1], strict=True):
            y = x @ weight.T
            norm = Norm.of(kernels.row_sums(y.numpy(), starts, size), count, gamma, beta, eps)
            x = torch.empty_like(y)
            kernels.activate(y.numpy(), norm.scale.numpy(), norm.shift.numpy(), x.numpy())
            hidden.append(y)
            inputs.append(x)
            norms.append(norm)
        best, where, sums = _pooled(x, weights[-1], gammas[-1], starts, size)
        norms.append(Norm.of(sums, count, gammas[-1], betas[-1], eps))
        out = torch.relu(norms[-1].scale * best + norms[-1].shift)
        ctx.save_for_backward(points, centres, *weights, *inputs, *hidden, best, out)
        ctx.rest = source, starts, size, where, norms, len(weights)
        stats = [value for norm in norms for value in (norm.mean, norm.variance)]
        ctx.mark_non_differentiable(*stats)
        return out, *stats

    @staticmethod
    def backward(ctx: Any, grad: Tensor, *_: Tensor) -> tuple[Tensor | None, ...]:
        source, starts, size, where, norms, layers = ctx.rest
        points, centres, *saved = ctx.saved_tensors
        weights, inputs = saved[:layers], saved[layers : 2 * layers]
        hidden, (best, out) = saved[2 * layers : -2], saved[-2:]
        count = (len(starts) - 1) * size
        grads: list[Tensor] = []
        # the pooled layer
        norm, weight, x = norms[-1], weights[-1], inputs[-1]
        grad = grad * (out > 0)
        sums = torch.stack([grad.sum(0), (grad * best).sum(0)]).double()
        gamma, beta, constant, slope = norm.backward(sums.numpy(), count)
        first = x[torch.from_numpy(starts[:-1])]
        again = torch.from_numpy(size - np.diff(starts)).to(x.dtype)[:, None]
        gram = x.T @ x + first.T @ (again * first)
        total = x.sum(0) + (again * first).sum(0)
        grad_weight = -constant[:, None] * total - slope[:, None] * (weight @ gram)
        grad_x = x @ (weight.T @ (slope[:, None] * weight))
        kernels.unpool(
            (norm.scale * grad).numpy(),
            where,
            weight.numpy(),
            (constant @ weight).numpy(),
            x.numpy(),
            starts,
            size,
            grad_x.numpy(),
            grad_weight.numpy(),
        )
        grads += [grad_weight, gamma, beta]
        # the layers between
        for layer in range(layers - 2, -1, -1):
            norm, y, x, weight = norms[layer + 1], hidden[layer], inputs[layer], weights[layer]
            sums = kernels.grad_sums(grad_x.numpy(), y.numpy())
            gamma, beta, constant, slope = norm.backward(sums, count)
            kernels.norm_grad(
                grad_x.numpy(),
                y.numpy(),
                norm.scale.numpy(),
                constant.numpy(),
                slope.numpy(),
                starts,
                size,
            )
            grads = [grad_x.T @ x, gamma, beta, *grads]
            grad_x = grad_x @ weight
            kernels.mask_grad(grad_x.numpy(), x.numpy())
        # the first layer
        norm, p, c = norms[0], points.numpy(), centres.numpy()
        sums = kernels.pair_grad_sums(grad_x.numpy(), p, c, source, starts)
        gamma, beta, constant, slope = norm.backward(sums, count)
        to_points, to_centres = torch.zeros_like(points), torch.zeros_like(centres)
        kernels.scatter_pairs(
            grad_x.numpy(),
            p,
            c,
            source,
            starts,
            size,
            norm.scale.numpy(),
            constant.numpy(),
            slope.numpy(),
            to_points.numpy(),
            to_centres.numpy(),
        )
        return to_points, to_centres, None, None, gamma, beta, *grads


Affine = tuple[Tensor, Tensor]
"""scale and shift `[C]` of a norm whose statistics are known."""


@torch.no_grad()
def ball_layers(
    points: Tensor, centres: Tensor, ball: Tensor, weights: Sequence[Tensor], norms: list[Affine]
) -> Tensor:
    """What `BallLayersFunction` answers where the norms' statistics are known; no gradients."""
    source, starts = kernels.compact(ball.numpy(), len(points) // len(ball))
    x = points.new_empty(len(source), points.shape[1])
    p, c = points.detach().numpy(), centres.detach().numpy()
    first, constant = (value.numpy() for value in norms[0])
    kernels.activate_pairs(p, c, source, starts, first, constant, x.numpy())
    for weight, norm in zip(weights[:-1], norms[1:-1], strict=True):
        x = norm_relu(x @ weight.T, norm)
    scale, shift = norms[-1]
    scaled = (scale[:, None] * weights[-1]).T.contiguous()
    best = x.new_empty(len(starts) - 1, len(shift))
    for begin, end in _chunks(starts, ball.shape[-1] * len(shift)):
        y = x[starts[begin] : starts[end]] @ scaled
        kernels.pool_only(y.numpy(), begin, end, starts, best.numpy())
    return best.add_(shift).relu_()


@torch.no_grad()
def norm_relu(rows: Tensor, norm: Affine) -> Tensor:
    """relu(scale rows + shift), `[R, C]`; no gradients."""
    out = torch.empty_like(rows)
    scale, shift = (value.numpy() for value in norm)
    kernels.activate(rows.detach().numpy(), scale, shift, out.numpy())
    return out


class NormReluFunction(torch.autograd.Function):
    """relu(norm(rows)) of `rows` `[R, C]`, and the rows' mean and biased variance `[C]`."""

    @staticmethod
    def forward(
        ctx: Any, rows: Tensor, gamma: Tensor, beta: Tensor, eps: float
    ) -> tuple[Tensor, Tensor, Tensor]:
        rows = rows.contiguous()
        starts = np.arange(len(rows) + 1)
        norm = Norm.of(kernels.row_sums(rows.numpy(), starts, 1), len(rows), gamma, beta, eps)
        out = torch.empty_like(rows)
        kernels.activate(rows.numpy(), norm.scale.numpy(), norm.shift.numpy(), out.numpy())
        ctx.save_for_backward(rows, out)
        ctx.rest = norm, starts
        ctx.mark_non_differentiable(norm.mean, norm.variance)
        return out, norm.mean, norm.variance

    @staticmethod
    def backward(ctx: Any, grad: Tensor, *_: Tensor) -> tuple[Tensor | None, ...]:
        rows, out = ctx.saved_tensors
        norm, starts = ctx.rest
        grad = grad.clone(memory_format=torch.contiguous_format)
        kernels.mask_grad(grad.numpy(), out.numpy())
        sums = kernels.grad_sums(grad.numpy(), rows.numpy())
        gamma, beta, constant, slope = norm.backward(sums, len(rows))
        kernels.norm_grad(
            grad.numpy(),
            rows.numpy(),
            norm.scale.numpy(),
            constant.numpy(),
            slope.numpy(),
            starts,
            1,
        )
        return grad, gamma, beta, None


def _parameters(parameters: tuple[Tensor, ...]) -> tuple[list[Tensor], list[Tensor], list[Tensor]]:
    """weights of all layers but the first, gammas and betas of all."""
    return list(parameters[2::3]), list(parameters[::3]), list(parameters[1::3])


def _pooled(
    x: Tensor, weight: Tensor, gamma: Tensor, starts: np.ndarray, size: int
) -> tuple[Tensor, np.ndarray, np.ndarray]:
    """y `[M, C]` where the norm of it is largest in each ball, its row, and sums of y and y^2."""
    sign = torch.where(gamma < 0, -1.0, 1.0).to(x.dtype)
    signed = (sign[:, None] * weight).T.contiguous()
    balls, channels = len(starts) - 1, len(weight)
    best = x.new_empty(balls, channels)
    where = np.empty((balls, channels), np.int32)
    sums = np.zeros((2, channels))
    for begin, end in _chunks(starts, size * channels):
        y = x[starts[begin] : starts[end]] @ signed
        kernels.pool(y.numpy(), begin, end, starts, size, best.numpy(), where, sums)
    sums[0] *= sign.numpy()
    return sign * best, where, sums


def _chunks(starts: np.ndarray, numbers: int) -> Iterator[tuple[int, int]]:
    """First and last of the balls that are pooled at once, where each has up to `numbers`."""
    balls = len(starts) - 1
    step = max(1, CHUNK_NUMBERS // numbers)
    return ((begin, min(begin + step, balls)) for begin in range(0, balls, step))
