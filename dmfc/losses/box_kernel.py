"""The compiled loop that finds points of a hand near links of the same hand, on the CPU."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def points_in_boxes(
    points: np.ndarray,
    rotation: np.ndarray,
    position: np.ndarray,
    lower: np.ndarray,
    upper: np.ndarray,
    link: np.ndarray,
    excluded: np.ndarray,
    inside: np.ndarray,
) -> None:
    """Set inside [n, L, P] where points [n, P, 3] are in the box lower..upper [L, 3] of a link.

    rotation [n, L, 3, 3] and position [n, L, 3] place the boxes among the points; link [P] is the
    link of each point; excluded [L, L] are the pairs that are left out.
    """
    for i in range(points.shape[0]):
        for b in range(lower.shape[0]):
            R, t, low, high = rotation[i, b], position[i, b], lower[b], upper[b]
            for p in range(points.shape[1]):
                if excluded[link[p], b]:
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
                inside[i, b, p] = low[2] <= along_z <= high[2]
