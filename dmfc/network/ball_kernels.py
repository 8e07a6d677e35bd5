"""Compiled loops behind `dmfc.network.balls`: what is done to rows between matrix products.

Rows `[E, C]` are those of all balls one after the other, a point of a ball once: ball i has the
rows starts[i] to starts[i+1], and its first row counts `size - n + 1` times, as a ball of n < size
points is padded with its first. Sums are in float64.
"""

from __future__ import annotations

import numba
import numpy as np

_compiled = numba.njit(cache=True, nogil=True)


@_compiled
def compact(index, cloud_size):  # type: ignore[no-untyped-def]
    """Padded balls `[B,M,k]` -> source `[E]` into the rows of all clouds, starts `[B*M+1]`."""
    batch, balls, size = index.shape
    starts = np.zeros(batch * balls + 1, np.int64)
    source = np.empty(index.size, np.int64)
    row = 0
    for b in range(batch):
        for m in range(balls):
            first = index[b, m, 0]
            source[row] = b * cloud_size + first
            row += 1
            for i in range(1, size):
                if index[b, m, i] != first:
                    source[row] = b * cloud_size + index[b, m, i]
                    row += 1
            starts[b * balls + m + 1] = row
    return source[:row].copy(), starts


@_compiled
def pair_sums(points, centres, source, starts, size):  # type: ignore[no-untyped-def]
    """Sums `[2, C]` of y and y^2, y = points[source] - centres[ball]."""
    sums = np.zeros((2, points.shape[1]))
    for ball in range(len(starts) - 1):
        weight = size - (starts[ball + 1] - starts[ball]) + 1.0
        for row in range(starts[ball], starts[ball + 1]):
            point = source[row]
            for c in range(points.shape[1]):
                y = np.float64(points[point, c] - centres[ball, c])
                sums[0, c] += weight * y
                sums[1, c] += weight * y * y
            weight = 1.0
    return sums


@_compiled
def activate_pairs(points, centres, source, starts, scale, shift, out):  # type: ignore[no-untyped-def]
    """out = relu(scale y + shift), y as in `pair_sums`."""
    zero = scale[0] * 0
    for ball in range(len(starts) - 1):
        for row in range(starts[ball], starts[ball + 1]):
            point = source[row]
            for c in range(points.shape[1]):
                x = scale[c] * (points[point, c] - centres[ball, c]) + shift[c]
                out[row, c] = x if x > zero else zero


@_compiled
def row_sums(rows, starts, size):  # type: ignore[no-untyped-def]
    """Sums `[2, C]` of y and y^2."""
    sums = np.zeros((2, rows.shape[1]))
    for ball in range(len(starts) - 1):
        weight = size - (starts[ball + 1] - starts[ball]) + 1.0
        for row in range(starts[ball], starts[ball + 1]):
            for c in range(rows.shape[1]):
                y = np.float64(rows[row, c])
                sums[0, c] += weight * y
                sums[1, c] += weight * y * y
            weight = 1.0
    return sums


@_compiled
def activate(rows, scale, shift, out):  # type: ignore[no-untyped-def]
    """out = relu(scale y + shift)."""
    zero = scale[0] * 0
    for row in range(len(rows)):
        for c in range(rows.shape[1]):
            x = scale[c] * rows[row, c] + shift[c]
            out[row, c] = x if x > zero else zero


@_compiled
def pool(rows, first, last, starts, size, best, where, sums):  # type: ignore[no-untyped-def]
    """Maximum `best` and its row `where` `[M, C]` for the balls first to last; adds to `sums`.

    `rows` begin with the first row of ball `first`.
    """
    offset = starts[first]
    plain, square = sums[0], sums[1]
    for ball in range(first, last):
        begin, end = starts[ball], starts[ball + 1]
        weight = size - (end - begin) + 1.0
        top, place = best[ball], where[ball]
        top[:] = rows[begin - offset]
        place[:] = begin
        for row in range(begin, end):
            value = rows[row - offset]
            here = np.int32(row)
            for c in range(len(value)):
                larger = value[c] > top[c]
                top[c] = value[c] if larger else top[c]
                place[c] = here if larger else place[c]
            for c in range(len(value)):
                y = np.float64(value[c])
                plain[c] += weight * y
                square[c] += weight * y * y
            weight = 1.0


@_compiled
def pool_only(rows, first, last, starts, best):  # type: ignore[no-untyped-def]
    """`best` of `pool` alone."""
    offset = starts[first]
    for ball in range(first, last):
        top = best[ball]
        top[:] = rows[starts[ball] - offset]
        for row in range(starts[ball] + 1, starts[ball + 1]):
            value = rows[row - offset]
            for c in range(len(value)):
                top[c] = value[c] if value[c] > top[c] else top[c]


@_compiled
def unpool(grad, where, weight, dense, x, starts, size, out, grad_weight):  # type: ignore[no-untyped-def]
    """Gradient of the layer before a pooled one, and the sparse part of that of its weights.

    grad `[M, C']` reaches the rows `where`, through `weight` `[C', C]`; dense `[C]` and what `out`
    holds come to each row as often as it counts, negative. Where `x` is 0 the gradient ends.
    """
    channels = x.shape[1]
    zero = dense[0] * 0
    for ball in range(len(starts) - 1):
        begin, end = starts[ball], starts[ball + 1]
        count = dense[0] * 0 + (size - (end - begin) + 1)
        for c in range(channels):
            out[begin, c] = -count * (out[begin, c] + dense[c])
        for row in range(begin + 1, end):
            for c in range(channels):
                out[row, c] = -(out[row, c] + dense[c])
        for k in range(grad.shape[1]):
            g = grad[ball, k]
            if g != zero:
                row = where[ball, k]
                for c in range(channels):
                    out[row, c] += g * weight[k, c]
                    grad_weight[k, c] += g * x[row, c]
        for row in range(begin, end):
            for c in range(channels):
                out[row, c] = out[row, c] if x[row, c] > zero else zero


@_compiled
def grad_sums(grad, rows):  # type: ignore[no-untyped-def]
    """Sums `[2, C]` of g and g y."""
    sums = np.zeros((2, rows.shape[1]))
    for row in range(len(rows)):
        for c in range(rows.shape[1]):
            g = np.float64(grad[row, c])
            sums[0, c] += g
            sums[1, c] += g * rows[row, c]
    return sums


@_compiled
def norm_grad(grad, rows, scale, constant, slope, starts, size):  # type: ignore[no-untyped-def]
    """In place: g -> scale g - count (constant + slope y)."""
    for ball in range(len(starts) - 1):
        begin = starts[ball]
        count = scale[0] * 0 + (size - (starts[ball + 1] - begin) + 1)
        for row in range(begin, starts[ball + 1]):
            for c in range(rows.shape[1]):
                grad[row, c] = scale[c] * grad[row, c] - count * (
                    constant[c] + slope[c] * rows[row, c]
                )
            count = scale[0] * 0 + 1


@_compiled
def mask_grad(grad, x):  # type: ignore[no-untyped-def]
    """In place: g where x > 0, else 0."""
    zero = grad[0, 0] * 0
    for row in range(len(x)):
        for c in range(x.shape[1]):
            grad[row, c] = grad[row, c] if x[row, c] > zero else zero


@_compiled
def pair_grad_sums(grad, points, centres, source, starts):  # type: ignore[no-untyped-def]
    """Sums `[2, C]` of g and g y, y as in `pair_sums`."""
    sums = np.zeros((2, points.shape[1]))
    for ball in range(len(starts) - 1):
        for row in range(starts[ball], starts[ball + 1]):
            point = source[row]
            for c in range(points.shape[1]):
                g = np.float64(grad[row, c])
                sums[0, c] += g
                sums[1, c] += g * (points[point, c] - centres[ball, c])
    return sums


@_compiled
def scatter_pairs(  # type: ignore[no-untyped-def]
    grad, points, centres, source, starts, size, scale, constant, slope, to_points, to_centres
):
    """Adds scale g - count (constant + slope y) to its point, and takes it from its centre."""
    for ball in range(len(starts) - 1):
        begin = starts[ball]
        count = scale[0] * 0 + (size - (starts[ball + 1] - begin) + 1)
        for row in range(begin, starts[ball + 1]):
            point = source[row]
            for c in range(points.shape[1]):
                y = points[point, c] - centres[ball, c]
                g = scale[c] * grad[row, c] - count * (constant[c] + slope[c] * y)
                to_points[point, c] += g
                to_centres[ball, c] -= g
            count = scale[0] * 0 + 1
