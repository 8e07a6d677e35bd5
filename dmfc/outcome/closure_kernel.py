"""The compiled loop that closes fingers on a cloud: where each would stop, and what it would touch.

A finger is a group of links with one number; its inner points are tried at ever more closed poses,
and it stops where the first of them comes within `TOUCH` of the cloud. The palm is group 0.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from dmfc.outcome.cells_kernel import nearest

TOUCH = 0.007
"""Metres between an inner point and the cloud, whose points are 5 to 9 mm apart, at contact."""
NEAR = 0.012
"""Metres: inner points of a finger that stopped which are this near count as contacts."""


@njit(cache=True, nogil=True)
def place(R: np.ndarray, t: np.ndarray, T: np.ndarray, local: np.ndarray, out: np.ndarray) -> None:
    """out [3] = R (T local) + t for a link's pose T [4, 4] in the palm frame."""
    x = T[0, 0] * local[0] + T[0, 1] * local[1] + T[0, 2] * local[2] + T[0, 3]
    y = T[1, 0] * local[0] + T[1, 1] * local[1] + T[1, 2] * local[2] + T[1, 3]
    z = T[2, 0] * local[0] + T[2, 1] * local[1] + T[2, 2] * local[2] + T[2, 3]
    for c in range(3):
        out[c] = R[c, 0] * x + R[c, 1] * y + R[c, 2] * z + t[c]


@njit(cache=True, nogil=True)
def turn(T: np.ndarray, normal: np.ndarray, out: np.ndarray) -> None:
    """out [3]: a direction of a link in the palm frame."""
    for c in range(3):
        out[c] = T[c, 0] * normal[0] + T[c, 1] * normal[1] + T[c, 2] * normal[2]


@njit(cache=True, nogil=True)
def close_on_cloud(
    R: np.ndarray,
    t: np.ndarray,
    poses: np.ndarray,
    group: np.ndarray,
    link: np.ndarray,
    inner: np.ndarray,
    points: np.ndarray,
    cell: float,
    low: np.ndarray,
    starts: np.ndarray,
    order: np.ndarray,
    stop: np.ndarray,
    gap: np.ndarray,
) -> None:
    """Fill stop [n, F] and gap [n, V] of hands at R [n, 3, 3], t [n, 3] in the world.

    poses [n, S, L, 4, 4]: links in the palm frame at S steps from open to squeezed; inner [V, 3]
    are points of links [V] in groups [V]. stop: the step at which a group touches, S where it never
    does (the palm: 0). gap: distance of each inner point to the cloud there, at most `cell`.
    """
    steps = poses.shape[1]
    where = np.empty(3)
    for i in range(t.shape[0]):
        stop[i, :] = steps
        stop[i, 0] = 0
        for s in range(steps):
            for v in range(link.shape[0]):
                if stop[i, group[v]] < s:
                    continue
                place(R[i], t[i], poses[i, s, link[v]], inner[v], where)
                _, gap[i, v] = nearest(
                    where[0], where[1], where[2], points, cell, low, starts, order
                )
                if gap[i, v] < TOUCH and stop[i, group[v]] > s:
                    stop[i, group[v]] = s


@njit(cache=True, nogil=True)
def contacts_of_closure(
    poses: np.ndarray,
    group: np.ndarray,
    link: np.ndarray,
    inner: np.ndarray,
    normals: np.ndarray,
    stop: np.ndarray,
    position: np.ndarray,
    direction: np.ndarray,
) -> None:
    """Fill position, direction [n, V, 3]: inner points and normals where their group stopped.

    All in the palm frame; a group that never stops is taken at the last step.
    """
    steps = poses.shape[1]
    unit, origin = np.eye(3), np.zeros(3)
    for i in range(poses.shape[0]):
        for v in range(link.shape[0]):
            T = poses[i, min(stop[i, group[v]], steps - 1), link[v]]
            place(unit, origin, T, inner[v], position[i, v])
            turn(T, normals[v], direction[i, v])


@njit(cache=True, nogil=True)
def gaps_at(
    R: np.ndarray,
    t: np.ndarray,
    poses: np.ndarray,
    link: np.ndarray,
    inner: np.ndarray,
    normals: np.ndarray,
    points: np.ndarray,
    cell: float,
    low: np.ndarray,
    starts: np.ndarray,
    order: np.ndarray,
    gap: np.ndarray,
    ahead: np.ndarray,
    places: np.ndarray,
) -> None:
    """Fill gap, ahead [n, V] of inner points of hands with links at poses [n, L, 4, 4].

    places [n, V, 3]: the inner points in the world; gap: distance to the nearest point of the
    cloud, at most `cell`; ahead: its part along the inner normal, negative where the point of the
    cloud is behind the surface of the hand.
    """
    facing = np.empty(3)
    for i in range(t.shape[0]):
        for v in range(link.shape[0]):
            T = poses[i, link[v]]
            where = places[i, v]
            place(R[i], t[i], T, inner[v], where)
            p, gap[i, v] = nearest(where[0], where[1], where[2], points, cell, low, starts, order)
            ahead[i, v] = cell
            if p < 0:
                continue
            turn(T, normals[v], facing)
            ahead[i, v] = 0.0
            for c in range(3):
                along = R[i, c, 0] * facing[0] + R[i, c, 1] * facing[1] + R[i, c, 2] * facing[2]
                ahead[i, v] += along * (points[p, c] - where[c])


@njit(cache=True, nogil=True)
def weakest_support(
    position: np.ndarray,
    direction: np.ndarray,
    touching: np.ndarray,
    centre: np.ndarray,
    directions: np.ndarray,
    friction: float,
    torque_weight: float,
    out: np.ndarray,
) -> None:
    """out [n]: min over directions [K, 6] of the wrench that contacts [n, V] can make along them.

    Each pushes along its direction [n, V, 3] with unit force and friction; torques are about
    centre [n, 3]. At most what the best contact does, and 0 without contacts.
    """
    for i in range(position.shape[0]):
        out[i] = np.inf
        for k in range(directions.shape[0]):
            best = 0.0
            for v in range(position.shape[1]):
                if not touching[i, v]:
                    continue
                best = max(
                    best,
                    _along(
                        position[i, v],
                        direction[i, v],
                        centre[i],
                        directions[k],
                        friction,
                        torque_weight,
                    ),
                )
            out[i] = min(out[i], best)
            if best == 0.0:
                break


@njit(cache=True, nogil=True)
def _along(
    p: np.ndarray,
    n: np.ndarray,
    centre: np.ndarray,
    s: np.ndarray,
    friction: float,
    torque_weight: float,
) -> float:
    """max(0, perp + mu par) of u = s_f + w (s_t x (p - c)): the support of a friction cone."""
    ax, ay, az = p[0] - centre[0], p[1] - centre[1], p[2] - centre[2]
    ux = s[0] + torque_weight * (s[4] * az - s[5] * ay)
    uy = s[1] + torque_weight * (s[5] * ax - s[3] * az)
    uz = s[2] + torque_weight * (s[3] * ay - s[4] * ax)
    perp = ux * n[0] + uy * n[1] + uz * n[2]
    squared = ux * ux + uy * uy + uz * uz - perp * perp
    return max(0.0, perp + friction * np.sqrt(max(squared, 0.0)))
