"""The compiled loop that describes how an object lies in the palm's frame."""

from __future__ import annotations

import numpy as np
from numba import njit

FAR = 0.3
"""Metres beyond which an object's ends are not distinguished."""
AROUND, BESIDE = 0.06, 0.08
"""Metres from where the hand grips: the object's near points, and those of others."""
COLUMNS = 20
"""Mean, lowest, highest, spread, near mean [3 each]; share near, its sideways distance, ..."""


@njit(cache=True, nogil=True)
def objects_in_palm(
    R: np.ndarray,
    t: np.ndarray,
    grip: np.ndarray,
    points: np.ndarray,
    label: np.ndarray,
    target: np.ndarray,
    out: np.ndarray,
) -> None:
    """Fill out [n, COLUMNS] for palms R [n, 3, 3], t [n, 3] that grip at [n, 3], all in the world.

    Points [N, 3] with label [N]; those of target [n] are the object. Columns: its mean, lower and
    upper ends, spread and the mean of what is near, each [3] in the palm frame; its share of the
    points, how far its mean is sideways of the grip, the share of it that is near; of the other
    points how many are beside the grip, in hundreds, and how near the nearest is.
    """
    local, mean = np.empty(3), np.empty(3)
    for i in range(t.shape[0]):
        row = out[i]
        row[:] = 0.0
        row[3:6], row[6:9] = np.inf, -np.inf
        mean[:] = 0.0
        near, beside, gap, count = 0, 0, 0.2, 0
        for p in range(points.shape[0]):
            dx, dy = points[p, 0] - grip[i, 0], points[p, 1] - grip[i, 1]
            dz = points[p, 2] - grip[i, 2]
            distance = np.sqrt(dx * dx + dy * dy + dz * dz)
            if label[p] != target[i]:
                gap = min(gap, distance)
                beside += distance < BESIDE
                continue
            for c in range(3):
                local[c] = 0.0
                for a in range(3):
                    local[c] += R[i, a, c] * (points[p, a] - t[i, a])
            count += 1
            close = distance < AROUND
            near += close
            for c in range(3):
                mean[c] += points[p, c]
                row[c] += local[c]
                row[3 + c] = min(row[3 + c], local[c])
                row[6 + c] = max(row[6 + c], local[c])
                row[9 + c] += local[c] * local[c]
                row[12 + c] += local[c] if close else 0.0
        for c in range(3):
            row[c] /= count
            row[3 + c], row[6 + c] = max(row[3 + c], -FAR), min(row[6 + c], FAR)
            row[9 + c] = np.sqrt(max(row[9 + c] / count - row[c] * row[c], 0.0))
            row[12 + c] = row[12 + c] / near if near else row[c]
        row[15] = count / points.shape[0]
        row[16] = np.hypot(mean[0] / count - grip[i, 0], mean[1] / count - grip[i, 1])
        row[17], row[18], row[19] = near / count, beside / 100, gap
