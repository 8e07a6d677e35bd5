"""The compiled loop behind `GridAtlas.distance` on the CPU."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True, nogil=True, error_model="numpy")
def distance_and_gradient(
    points: np.ndarray,
    rotation: np.ndarray,
    position: np.ndarray,
    grid: np.ndarray,
    values: np.ndarray,
    first: np.ndarray,
    size: np.ndarray,
    origin: np.ndarray,
    spacing: np.ndarray,
    near: bool,
    distance: np.ndarray,
    gradient: np.ndarray,
) -> None:
    """Fill distance [n, K, P] and its gradient [n, K, P, 3] with respect to points [n, P, 3].

    A gradient of size 0 is not filled. With `near` a point beyond the box of a grid is not looked
    up: its entries are left as they are.

    rotation [n, K, 3, 3] and position [n, K, 3] place grid[n, K] among the points; entries with a
    negative grid are left as they are.
    """
    local, node, out = np.empty(3), np.empty(3), np.empty(3)
    slope, cell, top = np.empty(3), np.empty(3, np.int64), np.empty(3)
    wanted = gradient.size > 0
    for i in range(points.shape[0]):
        for k in range(grid.shape[1]):
            g = grid[i, k]
            if g < 0:
                continue
            h, ny, nz = spacing[g], size[g, 1], size[g, 2]
            R, t = rotation[i, k], position[i, k]
            for c in range(3):
                top[c] = size[g, c] - 1
            for p in range(points.shape[1]):
                x = points[i, p, 0] - t[0]
                y = points[i, p, 1] - t[1]
                z = points[i, p, 2] - t[2]
                if not np.isfinite(x + y + z):  # a cell of it would be outside of the memory
                    distance[i, k, p] = np.nan
                    if wanted:
                        gradient[i, k, p, :] = np.nan
                    continue
                apart = 0.0
                for c in range(3):
                    local[c] = R[0, c] * x + R[1, c] * y + R[2, c] * z
                    node[c] = (local[c] - origin[g, c]) / h
                    clamped = min(max(node[c], 0.0), top[c])
                    out[c] = (node[c] - clamped) * h
                    apart += out[c] * out[c]
                    cell[c] = min(int(clamped), size[g, c] - 2)
                    node[c] = clamped - cell[c]
                if near and apart > 0.0:
                    continue
                corner = first[g] + (cell[0] * ny + cell[1]) * nz + cell[2]
                fx, fy, fz = node[0], node[1], node[2]
                v000, v001 = np.float64(values[corner]), np.float64(values[corner + 1])
                v010, v011 = np.float64(values[corner + nz]), np.float64(values[corner + nz + 1])
                corner += ny * nz
                v100, v101 = np.float64(values[corner]), np.float64(values[corner + 1])
                v110, v111 = np.float64(values[corner + nz]), np.float64(values[corner + nz + 1])
                v00, v01 = v000 + fx * (v100 - v000), v001 + fx * (v101 - v001)
                v10, v11 = v010 + fx * (v110 - v010), v011 + fx * (v111 - v011)
                v0, v1 = v00 + fy * (v10 - v00), v01 + fy * (v11 - v01)
                value = v0 + fz * (v1 - v0)
                apart = np.sqrt(apart)
                distance[i, k, p] = value - apart
                if not wanted:
                    continue
                d00, d01 = v100 - v000, v101 - v001
                d10, d11 = v110 - v010, v111 - v011
                slope[0] = (1 - fz) * (d00 + fy * (d10 - d00)) + fz * (d01 + fy * (d11 - d01))
                slope[1] = (1 - fz) * (v10 - v00) + fz * (v11 - v01)
                slope[2] = v1 - v0
                for c in range(3):
                    slope[c] = slope[c] / h if out[c] == 0.0 else -out[c] / apart
                for c in range(3):
                    gradient[i, k, p, c] = (
                        R[c, 0] * slope[0] + R[c, 1] * slope[1] + R[c, 2] * slope[2]
                    )
