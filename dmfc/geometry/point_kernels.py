"""Compiled loops behind `dmfc.geometry.points`, for batches of contiguous float arrays."""

from __future__ import annotations

import numba
import numpy as np

_compiled = numba.njit(cache=True, nogil=True)  # no fastmath: equal to the tensor path, bit by bit


def farthest_points(points: np.ndarray, count: int) -> np.ndarray:
    """See `dmfc.geometry.points.farthest_points`; `points` `[B,N,3]` float32 or float64."""
    chosen = np.empty((len(points), count), np.int64)
    bits = np.int32 if points.dtype == np.float32 else np.int64
    nearest = np.empty(points.shape[1], points.dtype)
    coordinates = np.ascontiguousarray(points.transpose(0, 2, 1))
    _farthest_points(coordinates, nearest, nearest.view(bits), chosen)
    return chosen


def ball_query(points: np.ndarray, centres: np.ndarray, radius: float, count: int) -> np.ndarray:
    """See `dmfc.geometry.points.ball_query`; `points` `[B,N,3]`, `centres` `[B,M,3]`."""
    index = np.zeros((*centres.shape[:2], count), np.int64)
    squared_radius = points.dtype.type(radius) * points.dtype.type(radius)
    coordinates = np.ascontiguousarray(points.transpose(0, 2, 1))
    _ball_query(coordinates, centres, squared_radius, np.empty(BLOCK, points.dtype), index)
    return index


def three_nearest(points: np.ndarray, queries: np.ndarray) -> np.ndarray:
    """See `dmfc.geometry.points.three_nearest`; `points` `[B,K,3]`, `queries` `[B,M,3]`."""
    index = np.empty((*queries.shape[:2], 3), np.int64)
    _three_nearest(points, queries, index)
    return index


BLOCK = 64  # points whose distances are found at once, before any is looked at


@_compiled
def _farthest_points(coordinates, nearest, key, chosen):  # type: ignore[no-untyped-def]
    size = coordinates.shape[2]
    for b in range(coordinates.shape[0]):
        x, y, z = coordinates[b, 0], coordinates[b, 1], coordinates[b, 2]
        nearest[:] = np.inf
        last = 0
        for k in range(chosen.shape[1]):
            chosen[b, k] = last
            cx, cy, cz = x[last], y[last], z[last]
            for i in range(size):
                dx, dy, dz = x[i] - cx, y[i] - cy, z[i] - cz
                d = dx * dx + dy * dy + dz * dz
                old = nearest[i]
                nearest[i] = d if d < old else old
            # non-negative floats sort as their bits do, and a maximum of integers is vectorised
            farthest = key[0]
            for i in range(size):
                bits = key[i]
                farthest = bits if bits > farthest else farthest
            last = 0
            while key[last] != farthest:
                last += 1


@_compiled
def _ball_query(coordinates, centres, squared_radius, squared, index):  # type: ignore[no-untyped-def]
    size, count = coordinates.shape[2], index.shape[2]
    for b in range(index.shape[0]):
        x, y, z = coordinates[b, 0], coordinates[b, 1], coordinates[b, 2]
        for m in range(index.shape[1]):
            cx, cy, cz = centres[b, m, 0], centres[b, m, 1], centres[b, m, 2]
            found = 0
            start = 0
            while start < size and found < count:
                length = min(BLOCK, size - start)
                for i in range(length):
                    dx, dy, dz = cx - x[start + i], cy - y[start + i], cz - z[start + i]
                    squared[i] = dx * dx + dy * dy + dz * dz
                for i in range(length):
                    if squared[i] < squared_radius and found < count:
                        index[b, m, found] = start + i
                        found += 1
                start += length
            for i in range(found, count):
                index[b, m, i] = index[b, m, 0]


@_compiled
def _three_nearest(points, queries, index):  # type: ignore[no-untyped-def]
    for b in range(index.shape[0]):
        for m in range(index.shape[1]):
            d0 = d1 = d2 = np.inf
            i0 = i1 = i2 = 0
            for k in range(points.shape[1]):
                dx = queries[b, m, 0] - points[b, k, 0]
                dy = queries[b, m, 1] - points[b, k, 1]
                dz = queries[b, m, 2] - points[b, k, 2]
                d = dx * dx + dy * dy + dz * dz
                if d < d0:
                    d2, i2, d1, i1, d0, i0 = d1, i1, d0, i0, d, k
                elif d < d1:
                    d2, i2, d1, i1 = d1, i1, d, k
                elif d < d2:
                    d2, i2 = d, k
            index[b, m, 0], index[b, m, 1], index[b, m, 2] = i0, i1, i2
