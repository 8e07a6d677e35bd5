"""The compiled loop that finds points of a hand near links of the same hand, on the CPU."""

from __future__ import annotations

import numpy as np
from numba import njit

ROUNDING = 1e-5  # metres by which spheres are larger, so that rounding loses no point


@njit(cache=True, nogil=True)
def points_in_boxes(
    points: np.ndarray,
    rotation: np.ndarray,
    position: np.ndarray,
    lower: np.ndarray,
    upper: np.ndarray,
    link: np.ndarray,
    excluded: np.ndarray,
) -> np.ndarray:
    """(i, b, p) [m, 3] of the points [n, P, 3] in the box lower..upper [L, 3] of a link, in order.

    rotation [n, L, 3, 3] and position [n, L, 3] place the boxes among the points; link [P] is the
    link of each point; excluded [L, L] are the pairs that are left out. A box that the sphere
    around a link's points does not reach is not compared with each of them.
    """
    links = lower.shape[0]
    sphere = np.empty((links, 4))
    reached = np.empty(links, np.bool_)
    found = np.empty((1024, 3), np.int64)
    count = 0
    for i in range(points.shape[0]):
        _spheres(points[i], link, sphere)
        for b in range(links):
            R, t, low, high = rotation[i, b], position[i, b], lower[b], upper[b]
            if not low[0] <= high[0]:
                continue
            for a in range(links):
                reached[a] = not excluded[a, b] and _reaches(sphere[a], R, t, low, high)
            for p in range(points.shape[1]):
                if not reached[link[p]]:
                    continue
                x = points[i, p, 0] - t[0]
                y = points[i, p, 1] - t[1]
                z = points[i, p, 2] - t[2]
                along_x = R[0, 0] * x + R[1, 0] * y + R[2, 0] * z
                if not low[0] <= along_x <= high[0]:
                    continue
                along_y = R[0, 1] * x + R[1, 1] * y + R[2, 1] * z
                if not low[1] <= along_y <= high[1]:
                    continue
                along_z = R[0, 2] * x + R[1, 2] * y + R[2, 2] * z
                if not low[2] <= along_z <= high[2]:
                    continue
                if count == len(found):
                    larger = np.empty((2 * count, 3), np.int64)
                    larger[:count] = found
                    found = larger
                found[count, 0], found[count, 1], found[count, 2] = i, b, p
                count += 1
    return found[:count].copy()


@njit(cache=True, nogil=True)
def _spheres(points: np.ndarray, link: np.ndarray, sphere: np.ndarray) -> None:
    """Fill sphere [L, 4]: mean and largest distance from it of the points of each link."""
    counts = np.zeros(len(sphere))
    sphere[:] = 0.0
    for p in range(len(points)):
        counts[link[p]] += 1
        for c in range(3):
            sphere[link[p], c] += points[p, c]
    for a in range(len(sphere)):
        for c in range(3):
            sphere[a, c] /= max(counts[a], 1.0)
        sphere[a, 3] = -1.0
    for p in range(len(points)):
        a, squared = link[p], 0.0
        for c in range(3):
            squared += (points[p, c] - sphere[a, c]) ** 2
        sphere[a, 3] = max(sphere[a, 3], squared)
    for a in range(len(sphere)):
        if sphere[a, 3] >= 0:
            sphere[a, 3] = np.sqrt(sphere[a, 3]) + ROUNDING


@njit(cache=True, nogil=True)
def _reaches(
    sphere: np.ndarray, R: np.ndarray, t: np.ndarray, low: np.ndarray, high: np.ndarray
) -> bool:
    """Whether a sphere (a radius below 0: none) reaches a box."""
    if sphere[3] < 0:
        return False
    x, y, z = sphere[0] - t[0], sphere[1] - t[1], sphere[2] - t[2]
    squared = 0.0
    for c in range(3):
        along = R[0, c] * x + R[1, c] * y + R[2, c] * z
        outside = max(low[c] - along, along - high[c], 0.0)
        squared += outside * outside
    return squared <= sphere[3] * sphere[3]
