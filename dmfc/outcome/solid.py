"""How deep a place is inside what was seen, though only surfaces were seen.

A cloud has no inside. A place is taken to be inside an object where an observed point is straight
above it and nearly every other way up or sideways leads to one: so it is in a ball and in a box,
and not in an open cup. What is under an overhang counts as free.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from scipy.ndimage import (
    binary_dilation,
    distance_transform_edt,
    generate_binary_structure,
    map_coordinates,
)

CELL = 0.01
"""Metres: width of a voxel, above the spacing of a cloud's points (5 to 9 mm)."""
MOST_VOXELS = 4_000_000
"""A cloud that reaches further has wider voxels."""
ENCLOSED = 15
"""Of the 17 ways, those that have to be blocked inside an object; a cloud has holes."""
_WAYS = np.array(
    [(x, y, z) for z in (0, 1) for x in (-1, 0, 1) for y in (-1, 0, 1) if z or x or y],
    dtype=np.int64,
)
"""[17, 3] steps to the neighbours of a voxel that are not below it."""
_UP = np.array([(0, 0, 1)], dtype=np.int64)
_FACES = generate_binary_structure(3, 1)


@dataclass(frozen=True)
class SolidField:
    """What a cloud encloses, on a grid; world frame, z up, the table at z = 0."""

    low: np.ndarray
    """[3] m: lower corner."""
    cell: float
    """Width of a voxel, m."""
    blocked: np.ndarray
    """[nx, ny, nz] u8: how many of the 17 ways up and sideways lead to an observed point."""
    depth: np.ndarray
    """[nx, ny, nz] f32 m: how far an enclosed voxel is from one that is not; 0 outside."""

    def __call__(self, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Depth in m, and share of blocked ways, at places [..., 3]; 0 beyond the grid."""
        where = np.moveaxis((places - self.low) / self.cell - 0.5, -1, 0)
        depth = map_coordinates(self.depth, where, order=1, mode="constant")
        blocked = map_coordinates(self.blocked, where, np.float32, order=1, mode="constant")
        return depth, blocked / len(_WAYS)


def solid_field(points: np.ndarray) -> SolidField:
    """The field of a cloud [N, 3], metres."""
    reach = np.ptp(points, axis=0) + 2 * CELL
    cell = max(CELL, float(np.cbrt(np.prod(reach) / MOST_VOXELS)))
    low = points.min(axis=0) - [cell, cell, 0.0]
    size = ((points.max(axis=0) - low) / cell).astype(np.int64) + 2
    seen = np.zeros(size, dtype=np.bool_)
    seen[tuple(((points - low) / cell).astype(np.int64).T)] = True
    # A voxel wider, so that no way leads through a hole between two points.
    wide = binary_dilation(seen, _FACES)
    blocked = blocked_ways(wide, _WAYS)
    covered = blocked_ways(wide, _UP) > 0
    solid = (covered & (blocked >= ENCLOSED)) | seen
    depth = np.maximum(cell * (distance_transform_edt(solid) - 1), 0).astype(np.float32)
    return SolidField(low, cell, blocked, depth)


@njit(cache=True, nogil=True)
def blocked_ways(seen: np.ndarray, ways: np.ndarray) -> np.ndarray:
    """[nx, ny, nz] u8: of ways [K, 3], how many meet a voxel of `seen` beyond each voxel."""
    nx, ny, nz = seen.shape
    count = np.zeros(seen.shape, np.uint8)
    blocked = np.zeros(seen.shape, np.bool_)
    for way in ways:
        dx, dy, dz = way
        for a in range(nx):
            i = nx - 1 - a if dx > 0 else a
            for b in range(ny):
                j = ny - 1 - b if dy > 0 else b
                for c in range(nz):
                    k = nz - 1 - c if dz > 0 else c
                    x, y, z = i + dx, j + dy, k + dz
                    inside = 0 <= x < nx and 0 <= y < ny and z < nz
                    blocked[i, j, k] = inside and (seen[x, y, z] or blocked[x, y, z])
                    count[i, j, k] += blocked[i, j, k]
    return count
