"""Compiled search for the nearest point of a cloud within a radius, by a grid of cells."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def fill_cells(points: np.ndarray, cell: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Cells of points [N, 3]: the lower corner [3], where each cell begins, and points by cell.

    Cells [nx, ny, nz] of this width reach one beyond the cloud; starts [nx + 1, ny, nz] flat holds,
    for each cell and the next, the range of its points in the order [N].
    """
    count = points.shape[0]
    low = np.full(3, np.inf)
    high = np.full(3, -np.inf)
    for p in range(count):
        for c in range(3):
            low[c] = min(low[c], points[p, c])
            high[c] = max(high[c], points[p, c])
    low -= cell
    size = np.empty(3, np.int64)
    for c in range(3):
        size[c] = int((high[c] - low[c]) / cell) + 2
    starts = np.zeros(size[0] * size[1] * size[2] + 4, np.int64)
    starts[-3:] = size
    where = np.empty(count, np.int64)
    for p in range(count):
        i = int((points[p, 0] - low[0]) / cell)
        j = int((points[p, 1] - low[1]) / cell)
        k = int((points[p, 2] - low[2]) / cell)
        where[p] = (i * size[1] + j) * size[2] + k
        starts[where[p] + 1] += 1
    for n in range(1, starts.shape[0] - 3):
        starts[n] += starts[n - 1]
    order = np.empty(count, np.int64)
    filled = starts.copy()
    for p in range(count):
        order[filled[where[p]]] = p
        filled[where[p]] += 1
    return low, starts, order


@njit(cache=True, nogil=True)
def nearest(
    x: float,
    y: float,
    z: float,
    points: np.ndarray,
    cell: float,
    low: np.ndarray,
    starts: np.ndarray,
    order: np.ndarray,
) -> tuple[int, float]:
    """The point of `fill_cells` nearest to a place and its distance; -1, cell: none within it."""
    nx, ny, nz = starts[-3], starts[-2], starts[-1]
    best, found = cell * cell, -1
    i, j, k = int((x - low[0]) // cell), int((y - low[1]) // cell), int((z - low[2]) // cell)
    if i < -1 or j < -1 or k < -1 or i > nx or j > ny or k > nz:
        return found, cell
    for a in range(max(i - 1, 0), min(i + 2, nx)):
        for b in range(max(j - 1, 0), min(j + 2, ny)):
            row = (a * ny + b) * nz
            for n in range(starts[row + max(k - 1, 0)], starts[row + min(k + 1, nz - 1) + 1]):
                p = order[n]
                dx, dy, dz = points[p, 0] - x, points[p, 1] - y, points[p, 2] - z
                squared = dx * dx + dy * dy + dz * dz
                if squared < best:
                    best, found = squared, p
    return found, np.sqrt(best)
