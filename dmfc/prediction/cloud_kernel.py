"""The compiled loop behind `CloudCheck`: how deep points lie inside hands on the approach."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def deepest_points(
    points: np.ndarray,
    rotation: np.ndarray,
    position: np.ndarray,
    T_palm_link: np.ndarray,
    normal: np.ndarray,
    offsets: np.ndarray,
    lower: np.ndarray,
    upper: np.ndarray,
    values: np.ndarray,
    first: np.ndarray,
    size: np.ndarray,
    origin: np.ndarray,
    spacing: np.ndarray,
    enough: float,
    out: np.ndarray,
) -> None:
    """out [n]: the deepest that one of points [N, 3] is in hand i on its way, metres; -1: in none.

    rotation [n, 3, 3], position [n, 3] place the palm at the grasp; the hand is looked at where the
    palm is moved by -s * normal [3] (palm frame) for each s of offsets [W]. lower, upper [L, 3] are
    boxes of links, the rest the links' grids (`GridAtlas`). The search in a hand ends once a depth
    is more than `enough`, which is then its answer.
    """
    links = lower.shape[0]
    low, high = np.empty((links, 3)), np.empty((links, 3))
    for i in range(position.shape[0]):
        out[i] = -1.0
        all_low, all_high = _swept_boxes(T_palm_link[i], normal, offsets, lower, upper, low, high)
        R, t = rotation[i], position[i]
        for p in range(points.shape[0]):
            x, y, z = points[p, 0] - t[0], points[p, 1] - t[1], points[p, 2] - t[2]
            px = R[0, 0] * x + R[1, 0] * y + R[2, 0] * z
            if px < all_low[0] or px > all_high[0]:
                continue
            py = R[0, 1] * x + R[1, 1] * y + R[2, 1] * z
            if py < all_low[1] or py > all_high[1]:
                continue
            pz = R[0, 2] * x + R[1, 2] * y + R[2, 2] * z
            if pz < all_low[2] or pz > all_high[2]:
                continue
            for k in range(links):
                if (
                    px < low[k, 0]
                    or px > high[k, 0]
                    or py < low[k, 1]
                    or py > high[k, 1]
                    or pz < low[k, 2]
                    or pz > high[k, 2]
                ):
                    continue
                T = T_palm_link[i, k]
                for w in range(offsets.shape[0]):
                    x = px + offsets[w] * normal[0] - T[0, 3]
                    y = py + offsets[w] * normal[1] - T[1, 3]
                    z = pz + offsets[w] * normal[2] - T[2, 3]
                    lx = T[0, 0] * x + T[1, 0] * y + T[2, 0] * z
                    ly = T[0, 1] * x + T[1, 1] * y + T[2, 1] * z
                    lz = T[0, 2] * x + T[1, 2] * y + T[2, 2] * z
                    if (
                        lower[k, 0] <= lx <= upper[k, 0]
                        and lower[k, 1] <= ly <= upper[k, 1]
                        and lower[k, 2] <= lz <= upper[k, 2]
                    ):
                        deep = _lookup(lx, ly, lz, k, values, first, size, origin, spacing)
                        out[i] = max(out[i], deep)
            if out[i] > enough:
                break


@njit(cache=True, nogil=True)
def _swept_boxes(
    T_palm_link: np.ndarray,
    normal: np.ndarray,
    offsets: np.ndarray,
    lower: np.ndarray,
    upper: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Fill low, high [L, 3]: boxes along the palm's axes of links at all offsets. Their box."""
    all_low, all_high = np.full(3, np.inf), np.full(3, -np.inf)
    for k in range(lower.shape[0]):
        if not lower[k, 0] <= upper[k, 0]:
            low[k, :], high[k, :] = np.inf, -np.inf
            continue
        for c in range(3):
            centre, half = T_palm_link[k, c, 3], 0.0
            for a in range(3):
                centre += T_palm_link[k, c, a] * (lower[k, a] + upper[k, a]) / 2
                half += abs(T_palm_link[k, c, a]) * (upper[k, a] - lower[k, a]) / 2
            ends = -normal[c] * offsets.min(), -normal[c] * offsets.max()
            low[k, c] = centre - half + min(ends)
            high[k, c] = centre + half + max(ends)
            all_low[c] = min(all_low[c], low[k, c])
            all_high[c] = max(all_high[c], high[k, c])
    return all_low, all_high


@njit(cache=True, nogil=True)
def _lookup(
    x: float,
    y: float,
    z: float,
    g: int,
    values: np.ndarray,
    first: np.ndarray,
    size: np.ndarray,
    origin: np.ndarray,
    spacing: np.ndarray,
) -> float:
    """Trilinear value of grid g at a point inside its box."""
    h = spacing[g]
    nx = min(max((x - origin[g, 0]) / h, 0.0), size[g, 0] - 1.0)
    ny = min(max((y - origin[g, 1]) / h, 0.0), size[g, 1] - 1.0)
    nz = min(max((z - origin[g, 2]) / h, 0.0), size[g, 2] - 1.0)
    i, j, k = (
        min(int(nx), size[g, 0] - 2),
        min(int(ny), size[g, 1] - 2),
        min(int(nz), size[g, 2] - 2),
    )
    fx, fy, fz = nx - i, ny - j, nz - k
    row, sheet = size[g, 2], size[g, 1] * size[g, 2]
    at = first[g] + i * sheet + j * row + k
    v00 = values[at] + fx * (values[at + sheet] - values[at])
    v01 = values[at + 1] + fx * (values[at + sheet + 1] - values[at + 1])
    v10 = values[at + row] + fx * (values[at + sheet + row] - values[at + row])
    v11 = values[at + row + 1] + fx * (values[at + sheet + row + 1] - values[at + row + 1])
    v0, v1 = v00 + fy * (v10 - v00), v01 + fy * (v11 - v01)
    return v0 + fz * (v1 - v0)


@njit(cache=True, nogil=True)
def lowest_points(
    up: np.ndarray,
    height: np.ndarray,
    T_palm_link: np.ndarray,
    link: np.ndarray,
    points: np.ndarray,
    out: np.ndarray,
) -> None:
    """out [n]: the least height of points [P, 3] of links [P] of hands, metres.

    up [n, 3] is the world's z axis in the palm frame, height [n] that of the palm's origin.
    """
    links = T_palm_link.shape[1]
    down, base = np.empty((links, 3)), np.empty(links)
    for i in range(up.shape[0]):
        for k in range(links):
            T = T_palm_link[i, k]
            base[k] = height[i]
            for c in range(3):
                base[k] += up[i, c] * T[c, 3]
                down[k, c] = up[i, 0] * T[0, c] + up[i, 1] * T[1, c] + up[i, 2] * T[2, c]
        out[i] = np.inf
        for p in range(points.shape[0]):
            k = link[p]
            z = base[k] + down[k, 0] * points[p, 0] + down[k, 1] * points[p, 1]
            out[i] = min(out[i], z + down[k, 2] * points[p, 2])
