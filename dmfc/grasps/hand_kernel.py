"""Compiled loops of the proposals: a hand is placed and compared with an object's distance grid.

Links, and clusters of neighbouring points on them, whose bounding spheres cannot matter are passed
over, so that of 2,000 points few are looked up. Signed distances are positive inside; the object
frame throughout; metres and radians.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from dmfc.grasps.hand_arrays import GridArrays, HandArrays

ALL = -2
"""In place of a finger: every link of the hand."""
FAR = -0.02
"""A finger this far off is not measured any closer while it comes, metres."""


@njit(cache=True, error_model="numpy")
def lookup(grid: GridArrays, x: float, y: float, z: float) -> float:
    """Signed distance at a point, as `Grid.distance` defines it."""
    values, origin, h = grid.values, grid.origin, grid.spacing
    u = (x - origin[0]) / h
    v = (y - origin[1]) / h
    w = (z - origin[2]) / h
    cu = min(max(u, 0.0), values.shape[0] - 1.0)
    cv = min(max(v, 0.0), values.shape[1] - 1.0)
    cw = min(max(w, 0.0), values.shape[2] - 1.0)
    i = min(int(cu), values.shape[0] - 2)
    j = min(int(cv), values.shape[1] - 2)
    k = min(int(cw), values.shape[2] - 2)
    fx, fy, fz = cu - i, cv - j, cw - k
    a = values[i, j, k] * (1 - fz) + values[i, j, k + 1] * fz
    b = values[i, j + 1, k] * (1 - fz) + values[i, j + 1, k + 1] * fz
    c = values[i + 1, j, k] * (1 - fz) + values[i + 1, j, k + 1] * fz
    d = values[i + 1, j + 1, k] * (1 - fz) + values[i + 1, j + 1, k + 1] * fz
    inside = (a * (1 - fy) + b * fy) * (1 - fx) + (c * (1 - fy) + d * fy) * fx
    out = (u - cu) ** 2 + (v - cv) ** 2 + (w - cw) ** 2
    return inside - h * np.sqrt(out)


@njit(cache=True, error_model="numpy")
def place(
    hand: HandArrays,
    rotation: np.ndarray,
    position: np.ndarray,
    joints: np.ndarray,
    R: np.ndarray,
    t: np.ndarray,
) -> None:
    """Poses of the links, R [L, 3, 3] and t [L, 3], from the palm's and joints [D]."""
    local = np.empty((3, 3))
    R[0], t[0] = rotation, position
    for link in range(1, len(hand.parents)):
        parent, T = hand.parents[link], hand.T_parent_link[link]
        for i in range(3):
            t[link, i] = t[parent, i]
            for k in range(3):
                t[link, i] += R[parent, i, k] * T[k, 3]
        for i in range(3):
            for j in range(3):
                local[i, j] = 0.0
                for k in range(3):
                    local[i, j] += R[parent, i, k] * T[k, j]
        if hand.dof[link] < 0:
            R[link] = local
            continue
        angle = hand.scale[link] * joints[hand.dof[link]]
        s, c = np.sin(angle), np.cos(angle)
        x, y, z = hand.axis[link]
        for i in range(3):
            p, q, r = local[i, 0], local[i, 1], local[i, 2]
            along = (p * x + q * y + r * z) * (1 - c)
            R[link, i, 0] = p * c + (q * z - r * y) * s + x * along
            R[link, i, 1] = q * c + (r * x - p * z) * s + y * along
            R[link, i, 2] = r * c + (p * y - q * x) * s + z * along


@njit(cache=True, error_model="numpy", inline="always")
def _moved(
    Q: np.ndarray, o: np.ndarray, p: np.ndarray, shift: np.ndarray
) -> tuple[float, float, float]:
    """Q p + o + shift."""
    return (
        Q[0, 0] * p[0] + Q[0, 1] * p[1] + Q[0, 2] * p[2] + o[0] + shift[0],
        Q[1, 0] * p[0] + Q[1, 1] * p[1] + Q[1, 2] * p[2] + o[1] + shift[1],
        Q[2, 0] * p[0] + Q[2, 1] * p[1] + Q[2, 2] * p[2] + o[2] + shift[2],
    )


@njit(cache=True, error_model="numpy")
def deepest(
    hand: HandArrays,
    R: np.ndarray,
    t: np.ndarray,
    finger: int,
    shift: np.ndarray,
    grid: GridArrays,
    floor: float,
    enough: float,
) -> float:
    """Largest signed distance of the points of a finger (or `ALL`), moved by shift [3].

    The answer is at least `floor`. A value above `enough` may be any such value.
    """
    best = floor
    # Of the lookup: 1 in the grid but for its error of 0.7 voxels at each end, sqrt(2) beyond it.
    slope, error = 1.4143, 1.5 * grid.spacing
    for link in range(len(hand.parents)):
        if hand.link_radius[link] < 0 or (finger != ALL and hand.finger[link] != finger):
            continue
        Q, o = R[link], t[link]
        x, y, z = _moved(Q, o, hand.link_centre[link], shift)
        if lookup(grid, x, y, z) + slope * hand.link_radius[link] + error <= best:
            continue
        for c in range(hand.clusters[link], hand.clusters[link + 1]):
            x, y, z = _moved(Q, o, hand.centre[c], shift)
            if lookup(grid, x, y, z) + slope * hand.radius[c] + error <= best:
                continue
            for row in range(hand.first[c], hand.first[c + 1]):
                x, y, z = _moved(Q, o, hand.points[row], shift)
                depth = lookup(grid, x, y, z)
                if depth > best:
                    best = depth
                    if best > enough:
                        return best
    return best


@njit(cache=True, error_model="numpy")
def above(
    hand: HandArrays, R: np.ndarray, t: np.ndarray, shift: np.ndarray, plane: np.ndarray
) -> bool:
    """Whether every point, moved by shift, has plane[:3] . p + plane[3] > 0."""
    a, b, c = plane[0], plane[1], plane[2]
    steep = np.sqrt(a * a + b * b + c * c)
    for link in range(len(hand.parents)):
        if hand.link_radius[link] < 0:
            continue
        Q = R[link]
        u = a * Q[0, 0] + b * Q[1, 0] + c * Q[2, 0]
        v = a * Q[0, 1] + b * Q[1, 1] + c * Q[2, 1]
        w = a * Q[0, 2] + b * Q[1, 2] + c * Q[2, 2]
        base = plane[3]
        for i in range(3):
            base += plane[i] * (t[link, i] + shift[i])
        p = hand.link_centre[link]
        if base + u * p[0] + v * p[1] + w * p[2] > steep * hand.link_radius[link]:
            continue
        first, last = hand.clusters[link], hand.clusters[link + 1]
        for row in range(hand.first[first], hand.first[last]):
            p = hand.points[row]
            if base + u * p[0] + v * p[1] + w * p[2] <= 0.0:
                return False
    return True


@njit(cache=True, error_model="numpy")
def back_off(
    hand: HandArrays,
    grid: GridArrays,
    rotation: np.ndarray,
    position: np.ndarray,
    joints: np.ndarray,
    back: np.ndarray,
    planes: np.ndarray,
    steps: np.ndarray,
    clearance: float,
) -> np.ndarray:
    """First of the `steps` along back [B, 3] at which each hand is free of object and table.

    [B]; NaN: at none. planes [B, 4] as in `above`.
    """
    links = len(hand.parents)
    R, t = np.empty((links, 3, 3)), np.empty((links, 3))
    found = np.full(len(position), np.nan)
    for b in range(len(position)):
        place(hand, rotation[b], position[b], joints[b], R, t)
        for step in steps:
            shift = step * back[b]
            if not above(hand, R, t, shift, planes[b]):
                continue
            if deepest(hand, R, t, ALL, shift, grid, -clearance, -clearance) <= -clearance:
                found[b] = step
                break
    return found


@njit(cache=True, error_model="numpy")
def close(
    hand: HandArrays,
    grid: GridArrays,
    rotation: np.ndarray,
    position: np.ndarray,
    joints: np.ndarray,
    step: float,
    steps: int,
    closed: np.ndarray,
    touching: np.ndarray,
) -> None:
    """Close every finger along the flexion until it touches.

    Fills closed [B, F], rad along the flexion (0: never touches), and touching [B, F] bool.
    """
    links, fingers = len(hand.parents), closed.shape[1]
    R, t = np.empty((links, 3, 3)), np.empty((links, 3))
    still, before = np.zeros(3), np.empty(fingers)
    for b in range(len(position)):
        before[:] = -np.inf
        for k in range(steps + 1):
            if touching[b].all():
                break
            angles = joints[b] + k * step * hand.flexion
            angles = np.minimum(np.maximum(angles, hand.lower), hand.upper)
            place(hand, rotation[b], position[b], angles, R, t)
            for f in range(fingers):
                if touching[b, f]:
                    continue
                depth = deepest(hand, R, t, f, still, grid, FAR, np.inf)
                if depth > 0.0:
                    # Where the distance, linear between two steps, crosses zero.
                    share = depth / (depth - before[f]) if k > 0 else 0.0
                    closed[b, f] = (k - share) * step
                    touching[b, f] = True
                before[f] = depth


@njit(cache=True, error_model="numpy")
def reachable(
    hand: HandArrays,
    grid: GridArrays,
    rotation: np.ndarray,
    position: np.ndarray,
    opened: np.ndarray,
    joints: np.ndarray,
    back: np.ndarray,
    planes: np.ndarray,
    offsets: np.ndarray,
    tolerance: float,
) -> np.ndarray:
    """[B] whether the hand, `opened` and closed, is above the table, and comes there open.

    It comes along back [B, 3], where it is checked at `offsets` [W] from the grasp, and may be
    `tolerance` inside the object (`dmfc.hand.approach`).
    """
    links = len(hand.parents)
    R, t, still = np.empty((links, 3, 3)), np.empty((links, 3)), np.zeros(3)
    found = np.zeros(len(position), dtype=np.bool_)
    for b in range(len(position)):
        place(hand, rotation[b], position[b], joints[b], R, t)
        fits = above(hand, R, t, still, planes[b])
        if fits:
            place(hand, rotation[b], position[b], opened[b], R, t)
            fits = above(hand, R, t, still, planes[b])
        for offset in offsets:
            if not fits:
                break
            shift = offset * back[b]
            fits = deepest(hand, R, t, ALL, shift, grid, tolerance, tolerance) <= tolerance
        found[b] = fits
    return found


@njit(cache=True, error_model="numpy")
def widths(
    points: np.ndarray,
    target: np.ndarray,
    approach: np.ndarray,
    rolls: np.ndarray,
    reach: float,
    aside: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Extent of the object along rolls [K, B, 3] in front of the target [B, 3], [K, B] x 2.

    Of points [S, 3] those count that are at most `reach` deep along the approach [B, 3] and
    `aside` from the plane of approach and roll. Lowest and highest; inf and -inf without any.
    """
    low = np.full(rolls.shape[:2], np.inf)
    high = np.full(rolls.shape[:2], -np.inf)
    for b in range(len(target)):
        for s in range(len(points)):
            x = points[s, 0] - target[b, 0]
            y = points[s, 1] - target[b, 1]
            z = points[s, 2] - target[b, 2]
            a = approach[b]
            depth = x * a[0] + y * a[1] + z * a[2]
            if depth <= -0.01 or depth >= reach:
                continue
            for k in range(len(rolls)):
                r = rolls[k, b]
                along = x * r[0] + y * r[1] + z * r[2]
                off = x * x + y * y + z * z - along * along - depth * depth
                if off < aside * aside:
                    low[k, b] = min(low[k, b], along)
                    high[k, b] = max(high[k, b], along)
    return low, high
