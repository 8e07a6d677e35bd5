"""Point-cloud operators: farthest point sampling, ball query, three nearest neighbours.

Each takes one cloud `[N,3]` or a batch `[B,N,3]`, as numpy array or torch tensor, and answers in
kind. On the CPU they are compiled loops; elsewhere, and for tensors where `dmfc.geometry.compiled`
says so, tensor operations that give the same indices.
No operator carries a gradient: each answers indices, or weights that are constants of the network.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import torch

from dmfc.errors import DmfcError
from dmfc.geometry import point_kernels as kernels
from dmfc.geometry.compiled import compiled_loops

Array = Any  # np.ndarray or torch.Tensor: what comes in goes out

MIN_SQUARED_DISTANCE = (
    1e-10  # m^2: keeps the weight of a coinciding point finite, as PointNet++ does
)


def farthest_points(points: Array, count: int) -> Array:
    """Indices `[.., count]` (int64) of farthest point sampling of `points` `[.., N, 3]`.

    Starts at index 0; every next point is the one farthest from all chosen so far, the lowest index
    where several are. So the first k of a longer sample are the sample of k, and sampling the
    sample again gives its prefix. Raises DmfcError where the cloud has fewer than `count` points.
    """
    if not 1 <= count <= points.shape[-2]:
        raise DmfcError(
            f"cannot sample {count} farthest points of a cloud of {points.shape[-2]} "
            "(network.levels, scenes.points)"
        )
    return _dispatch(
        lambda p: kernels.farthest_points(p, count),
        lambda p: _farthest_points_torch(p, count),
        points,
    )


def ball_query(points: Array, centres: Array, radius: float, count: int) -> Array:
    """Indices `[.., M, count]` (int64) into `points` `[.., N, 3]` around `centres` `[.., M, 3]`.

    The first `count` points, in index order, nearer than `radius` metres, padded with the first of
    them (Qi et al. 2017, PointNet++). A ball without any point holds index 0.
    """
    return _dispatch(
        lambda p, c: kernels.ball_query(p, c, radius, count),
        lambda p, c: _ball_query_torch(p, c, radius, count),
        points,
        centres,
    )


def three_nearest(points: Array, queries: Array) -> tuple[Array, Array]:
    """Indices and weights `[.., M, 3]` of the 3 of `points` `[.., K, 3]` nearest to each query.

    Nearest first, the lower index first where two are as near. Weights are inverse squared
    distances that sum to 1 (Qi et al. 2017). Raises DmfcError for fewer than 3 points.
    """
    if points.shape[-2] < 3:
        raise DmfcError(
            f"cannot interpolate from {points.shape[-2]} points: at least 3 are needed "
            "(network.levels)"
        )
    index = _dispatch(kernels.three_nearest, _three_nearest_torch, points, queries)
    near = take_points(points, index)
    squared = ((near - queries[..., None, :]) ** 2).sum(-1)
    inverse = 1.0 / squared.clip(MIN_SQUARED_DISTANCE)
    return index, inverse / inverse.sum(-1)[..., None]


def take_points(values: Array, index: Array) -> Array:
    """`values` `[.., N, C]` at `index` `[.., *S]` of each cloud: `[.., *S, C]`."""
    if values.ndim == 2:
        return values[index]
    first = np.arange(len(values)) if isinstance(values, np.ndarray) else _arange_like(values)
    return values[first.reshape(-1, *[1] * (index.ndim - 1)), index]


def _arange_like(values: torch.Tensor) -> torch.Tensor:
    return torch.arange(len(values), device=values.device)


def _dispatch(
    compiled: Callable[..., np.ndarray], tensor: Callable[..., torch.Tensor], *clouds: Array
) -> Array:
    """Runs `compiled` on CPU data and `tensor` elsewhere, on batches, in one float type."""
    single = clouds[0].ndim == 2
    is_numpy = isinstance(clouds[0], np.ndarray)
    if not is_numpy:
        clouds = tuple(cloud.detach() for cloud in clouds)
    if is_numpy or (clouds[0].device.type == "cpu" and compiled_loops()):
        kind = np.float64 if _is_double(clouds[0]) else np.float32
        arrays = [np.ascontiguousarray(np.asarray(cloud), dtype=kind) for cloud in clouds]
        index = compiled(*[array[None] if single else array for array in arrays])
        result = index if is_numpy else torch.from_numpy(index)
    else:
        result = tensor(*[cloud[None] if single else cloud for cloud in clouds])
    return result[0] if single else result


def _is_double(cloud: Array) -> bool:
    return cloud.dtype in (np.float64, torch.float64)


def _squared_distances(a: torch.Tensor, b: torch.Tensor) -> torch.Tensor:
    """`[B,M,N]` between `[B,M,3]` and `[B,N,3]`; summed in the kernels' order, so equal to them."""
    x, y, z = ((a[..., None, k] - b[:, None, :, k]).square() for k in range(3))
    return x + y + z


def _farthest_points_torch(points: torch.Tensor, count: int) -> torch.Tensor:
    batch = _arange_like(points)
    chosen = torch.zeros(len(points), count, dtype=torch.int64, device=points.device)
    nearest = torch.full(points.shape[:2], torch.inf, dtype=points.dtype, device=points.device)
    for k in range(1, count):
        last = points[batch, chosen[:, k - 1]]
        nearest = torch.minimum(nearest, _squared_distances(last[:, None], points)[:, 0])
        # argmax does not promise the first of several maxima; the largest of a descending key does
        is_farthest = nearest == nearest.amax(1, keepdim=True)
        order = torch.arange(points.shape[1], 0, -1, device=points.device)
        chosen[:, k] = (is_farthest * order).argmax(1)
    return chosen


def _ball_query_torch(
    points: torch.Tensor, centres: torch.Tensor, radius: float, count: int
) -> torch.Tensor:
    size = points.shape[1]
    squared_radius = torch.as_tensor(radius, dtype=points.dtype, device=points.device).square()
    inside = _squared_distances(centres, points) < squared_radius
    order = torch.arange(size, device=points.device).expand(inside.shape)
    taken = min(count, size)
    index = order.masked_fill(~inside, size).topk(taken, largest=False, sorted=True).values
    index = torch.nn.functional.pad(index, (0, count - taken), value=size)
    first = index[..., :1].masked_fill(index[..., :1] == size, 0)
    return torch.where(index == size, first, index)


def _three_nearest_torch(points: torch.Tensor, queries: torch.Tensor) -> torch.Tensor:
    return _squared_distances(queries, points).sort(dim=-1, stable=True).indices[..., :3]


def choose(available: int, count: int, generator: np.random.Generator) -> np.ndarray:
    """`count` of `available` indices in random order; all of them, then repeats, if too few."""
    if available >= count:
        return generator.choice(available, count, replace=False)
    repeats = generator.choice(available, count - available)
    return generator.permutation(np.concatenate([np.arange(available), repeats]))
