"""Signed distance of a triangle mesh on a grid, positive inside.

Distances: each triangle writes its exact distance to the nodes around it. On a grid of twice the
spacing, sweeps in the eight directions of the axes then hand the closest *triangle* on from node to
node; each node of the fine grid takes its exact distance to the triangles that are closest to the
eight coarse nodes around it. Signs: by the generalised winding number, which is right for meshes
with pinched edges and small holes too.
"""

from __future__ import annotations

import igl
import numba
import numpy as np
from scipy import ndimage

from dmfc.geometry.grid import Grid

_BAND = 1
"""Nodes around a triangle's bounding box that it writes to itself."""


def signed_distance_grid(
    vertices: np.ndarray,
    faces: np.ndarray,
    closed: bool,
    spacing: float,
    margin: float,
    max_voxels: int,
) -> Grid:
    """The grid over the mesh's box enlarged by `margin` (metres).

    vertices [V, 3], faces [F, 3] wound outwards. `closed`: no edge is open, so that sides can be
    told apart once per region. `spacing` (metres) is enlarged until there are at most `max_voxels`.
    """
    lower, upper = vertices.min(axis=0) - margin, vertices.max(axis=0) + margin
    spacing = max(spacing, float(np.prod(upper - lower) / max_voxels) ** (1 / 3))
    while True:
        shape = np.ceil((upper - lower) / spacing).astype(int) + 1
        if np.prod(shape) <= max_voxels:
            break
        spacing *= 1.01
    triangles = np.ascontiguousarray(vertices[faces], dtype=np.float64)
    distance = _unsigned(triangles, lower, spacing, shape[0], shape[1], shape[2])
    inside = _inside(distance, vertices, faces, closed, lower, spacing)
    return Grid(np.where(inside, distance, -distance).astype(np.float32), lower, spacing)


def _winding(points: np.ndarray, vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    return igl.fast_winding_number(
        np.ascontiguousarray(vertices, dtype=np.float64),
        np.ascontiguousarray(faces, dtype=np.int64),
        np.ascontiguousarray(points, dtype=np.float64),
    )


def _inside(
    distance: np.ndarray,
    vertices: np.ndarray,
    faces: np.ndarray,
    closed: bool,
    lower: np.ndarray,
    spacing: float,
) -> np.ndarray:
    """Which nodes are inside, [nx, ny, nz] bool.

    Two neighbouring nodes that are both more than half a spacing from a closed surface lie on
    the same side of it: one winding number per connected region of such nodes is enough.
    """
    inside = np.zeros(distance.shape, dtype=bool)
    far = distance > 0.51 * spacing if closed else np.zeros(distance.shape, dtype=bool)
    near = np.argwhere(~far)
    inside[tuple(near.T)] = _winding(lower + spacing * near, vertices, faces) > 0.5
    labels, count = ndimage.label(far)
    if count:
        regions = np.arange(1, count + 1)
        deepest = np.array(ndimage.maximum_position(distance, labels, regions))
        region_inside = _winding(lower + spacing * deepest, vertices, faces) > 0.5
        inside |= np.concatenate([[False], region_inside])[labels]
    return inside


@numba.njit(cache=True)
def _unsigned(triangles, lower, spacing, nx, ny, nz):  # type: ignore[no-untyped-def]
    squared = np.full((nx, ny, nz), np.inf)
    closest = np.full((nx, ny, nz), -1, dtype=np.int32)
    for t in range(len(triangles)):
        _write_around(triangles, t, lower, spacing, squared, closest)
    coarse = _closest_triangles(
        triangles, lower, 2 * spacing, nx // 2 + 1, ny // 2 + 1, nz // 2 + 1
    )
    for i in range(nx):
        for j in range(ny):
            for k in range(nz):
                _take_closest(triangles, lower, spacing, squared, closest, coarse, i, j, k)
    return np.sqrt(squared)


@numba.njit(cache=True)
def _closest_triangles(triangles, lower, spacing, nx, ny, nz):  # type: ignore[no-untyped-def]
    squared = np.full((nx, ny, nz), np.inf)
    closest = np.full((nx, ny, nz), -1, dtype=np.int32)
    for t in range(len(triangles)):
        _write_around(triangles, t, lower, spacing, squared, closest)
    for _ in range(2):
        for direction in range(8):
            dx = 1 if direction & 1 else -1
            dy = 1 if direction & 2 else -1
            dz = 1 if direction & 4 else -1
            _sweep(triangles, lower, spacing, squared, closest, dx, dy, dz)
    return closest


@numba.njit(cache=True)
def _take_closest(triangles, lower, spacing, squared, closest, coarse, i, j, k):  # type: ignore[no-untyped-def]
    for corner in range(8):
        u = i // 2 + (i & 1 & corner)
        v = j // 2 + (j & 1 & (corner >> 1))
        w = k // 2 + (k & 1 & (corner >> 2))
        if u >= coarse.shape[0] or v >= coarse.shape[1] or w >= coarse.shape[2]:
            continue
        t = coarse[u, v, w]
        if t >= 0 and t != closest[i, j, k]:
            value = _squared_distance(
                lower[0] + spacing * i,
                lower[1] + spacing * j,
                lower[2] + spacing * k,
                triangles[t],
            )
            if value < squared[i, j, k]:
                squared[i, j, k] = value
                closest[i, j, k] = t


@numba.njit(cache=True)
def _write_around(triangles, t, lower, spacing, squared, closest):  # type: ignore[no-untyped-def]
    first = np.zeros(3, dtype=np.int64)
    last = np.zeros(3, dtype=np.int64)
    for axis in range(3):
        corners = triangles[t, :, axis]
        first[axis] = max(int(np.floor((corners.min() - lower[axis]) / spacing)) - _BAND, 0)
        limit = squared.shape[axis] - 1
        last[axis] = min(int(np.ceil((corners.max() - lower[axis]) / spacing)) + _BAND, limit)
    for i in range(first[0], last[0] + 1):
        for j in range(first[1], last[1] + 1):
            for k in range(first[2], last[2] + 1):
                value = _squared_distance(
                    lower[0] + spacing * i,
                    lower[1] + spacing * j,
                    lower[2] + spacing * k,
                    triangles[t],
                )
                if value < squared[i, j, k]:
                    squared[i, j, k] = value
                    closest[i, j, k] = t


@numba.njit(cache=True)
def _sweep(triangles, lower, spacing, squared, closest, dx, dy, dz):  # type: ignore[no-untyped-def]
    nx, ny, nz = squared.shape
    for a in range(nx):
        i = a if dx > 0 else nx - 1 - a
        for b in range(ny):
            j = b if dy > 0 else ny - 1 - b
            for c in range(nz):
                k = c if dz > 0 else nz - 1 - c
                for corner in range(1, 8):
                    u = i - dx if corner & 1 else i
                    v = j - dy if corner & 2 else j
                    w = k - dz if corner & 4 else k
                    if u < 0 or v < 0 or w < 0 or u >= nx or v >= ny or w >= nz:
                        continue
                    t = closest[u, v, w]
                    if t < 0 or t == closest[i, j, k]:
                        continue
                    value = _squared_distance(
                        lower[0] + spacing * i,
                        lower[1] + spacing * j,
                        lower[2] + spacing * k,
                        triangles[t],
                    )
                    if value < squared[i, j, k]:
                        squared[i, j, k] = value
                        closest[i, j, k] = t


@numba.njit(cache=True, error_model="numpy")
def _squared_distance(px, py, pz, triangle):  # type: ignore[no-untyped-def]
    """Squared distance of a point to a triangle by its Voronoi regions (Ericson, Real-Time
    Collision Detection, 5.1.5)."""
    ax, ay, az = triangle[0, 0], triangle[0, 1], triangle[0, 2]
    abx, aby, abz = triangle[1, 0] - ax, triangle[1, 1] - ay, triangle[1, 2] - az
    acx, acy, acz = triangle[2, 0] - ax, triangle[2, 1] - ay, triangle[2, 2] - az
    apx, apy, apz = px - ax, py - ay, pz - az
    d1 = abx * apx + aby * apy + abz * apz
    d2 = acx * apx + acy * apy + acz * apz
    ab_ab = abx * abx + aby * aby + abz * abz
    ab_ac = abx * acx + aby * acy + abz * acz
    ac_ac = acx * acx + acy * acy + acz * acz
    d3, d4 = d1 - ab_ab, d2 - ab_ac
    d5, d6 = d1 - ab_ac, d2 - ac_ac
    va, vb, vc = d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2
    s, t = 0.0, 0.0
    if d1 <= 0 and d2 <= 0:
        s, t = 0.0, 0.0
    elif d3 >= 0 and d4 <= d3:
        s, t = 1.0, 0.0
    elif d6 >= 0 and d5 <= d6:
        s, t = 0.0, 1.0
    elif vc <= 0 and d1 >= 0 and d3 <= 0:
        s, t = d1 / ab_ab, 0.0
    elif vb <= 0 and d2 >= 0 and d6 <= 0:
        s, t = 0.0, d2 / ac_ac
    elif va <= 0 and d4 - d3 >= 0 and d5 - d6 >= 0:
        t = (d4 - d3) / ((d4 - d3) + (d5 - d6))
        s = 1.0 - t
    else:
        s, t = vb / (va + vb + vc), vc / (va + vb + vc)
    x, y, z = apx - s * abx - t * acx, apy - s * aby - t * acy, apz - s * abz - t * acz
    return x * x + y * y + z * z
