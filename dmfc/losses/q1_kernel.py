"""The compiled loop that finds the contact and direction of Q1's bound, on the CPU."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def critical(  # type: ignore[no-untyped-def]
    arms, normals, weight, directions, friction, smallest, floor, contact, direction
):
    """Fill contact [n] and direction [n] that attain min_j max_i of the exact supports.

    arms, normals [n, V, 3] and weight [n, V] of the contacts; directions [11, D], of each its
    force a, torque b, 2 a x b, |a|^2 and |b|^2; `smallest`: squared length that a root is taken
    of. All are of one float type, friction and `smallest` too.
    """
    count = directions.shape[1]
    a0, a1, a2, b0, b1, b2, c0, c1, c2, aa, bb = directions
    best, where = np.empty_like(aa), np.empty(count, np.int32)
    nothing = smallest * 0
    for i in range(len(arms)):
        for v in range(arms.shape[1]):
            r0, r1, r2 = arms[i, v]
            n0, n1, n2 = normals[i, v]
            m0, m1, m2 = r1 * n2 - r2 * n1, r2 * n0 - r0 * n2, r0 * n1 - r1 * n0
            rr, w = r0 * r0 + r1 * r1 + r2 * r2, weight[i, v]
            here = np.int32(v)
            for j in range(count):
                along = n0 * a0[j] + n1 * a1[j] + n2 * a2[j]
                along += m0 * b0[j] + m1 * b1[j] + m2 * b2[j]
                turn = r0 * b0[j] + r1 * b1[j] + r2 * b2[j]
                squared = aa[j] + r0 * c0[j] + r1 * c1[j] + r2 * c2[j] + rr * bb[j] - turn * turn
                across = squared - along * along
                across = across if across > smallest else smallest
                value = friction * np.sqrt(across) - along
                value = w * (nothing if floor and value < nothing else value)
                larger = v == 0 or value > best[j]
                best[j] = value if larger else best[j]
                where[j] = here if larger else where[j]
        lowest = best.argmin()
        contact[i], direction[i] = where[lowest], lowest
