"""Convex parts of a mesh, for the simulator's collisions."""

from __future__ import annotations

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from dmfc.config.objects import PrepareConfig
from dmfc.errors import DmfcError
from dmfc.objects.decompose import decompose
from dmfc.objects.mesh import CleanMesh, from_manifold, to_manifold

_MIN_PART_VOLUME = 1e-9
_FULL = 0.8
"""Share of its hull that an object without a cavity fills; fewer parts simulate faster."""
_SINGLE_VERTICES = 256
"""Most vertices of the hull of a nearly convex object: within 0.5 mm of a large ball."""
_SIMPLIFY = 0.0007
"""Metres by which the surface may move before the decomposition: the time of CoACD goes with the
number of faces, and its cutting planes follow every bump of a scan."""


def convex_parts(mesh: CleanMesh, config: PrepareConfig) -> list[np.ndarray]:
    """Convex hulls whose union approximates the mesh: their vertices, each [n, 3].

    A mesh that fills its hull up to `config.convex_single` is one part. Otherwise CoACD (Wei et
    al. 2022) decomposes it, simplified, with the concavity threshold in metres.
    """
    vertices, faces, solid = _simplified(mesh)
    hull = ConvexHull(vertices)
    filled = mesh.trimesh.volume / hull.volume
    if filled >= config.convex_single:
        return [_thinned(vertices[hull.vertices], _SINGLE_VERTICES)]
    threshold = config.convex_threshold_full if filled > _FULL else config.convex_threshold
    pieces = _decomposed(vertices, faces, solid, threshold, config)
    if pieces is None and solid:
        pieces = _decomposed(mesh.vertices, mesh.faces, True, threshold, config)
    if pieces is None:
        raise DmfcError(
            "CoACD crashed on the mesh, simplified and as it is (objects.prepare.convex_*)"
        )
    parts = [_hull(points) for points in pieces]
    kept = [_thinned(part, config.convex_vertices) for part in parts if part is not None]
    return kept or [_thinned(vertices[hull.vertices], config.convex_vertices)]


def _decomposed(
    vertices: np.ndarray, faces: np.ndarray, solid: bool, threshold: float, config: PrepareConfig
) -> list[np.ndarray] | None:
    """The points of CoACD's parts; None where it crashed."""
    return decompose(
        vertices,
        faces,
        threshold=threshold,
        real_metric=True,
        max_convex_hull=config.convex_max_parts,
        preprocess_mode="off" if solid else "on",
        resolution=config.convex_resolution,
        mcts_iterations=config.convex_iterations,
        mcts_nodes=15,
        mcts_max_depth=2,
        seed=0,
    )


def _simplified(mesh: CleanMesh) -> tuple[np.ndarray, np.ndarray, bool]:
    """(vertices, faces, whether they bound a solid), with fewer faces where that is safe."""
    solid = to_manifold(mesh.trimesh) if mesh.closed else None
    if solid is None:
        return mesh.vertices, mesh.faces, False
    extent = float(np.ptp(mesh.vertices, axis=0).min())
    vertices, faces = from_manifold(solid.simplify(min(_SIMPLIFY, 0.02 * extent)))
    return vertices, faces, True


def _hull(points: np.ndarray) -> np.ndarray | None:
    """Vertices of the hull; None for a part that is flat or smaller than a cubic millimetre."""
    try:
        hull = ConvexHull(points)
    except QhullError:
        return None
    return points[hull.vertices] if hull.volume > _MIN_PART_VOLUME else None


def _thinned(points: np.ndarray, limit: int) -> np.ndarray:
    """At most `limit` of the hull's vertices: those that support it in directions all around."""
    if len(points) <= limit:
        return points
    index = np.arange(limit) + 0.5
    polar, azimuth = np.arccos(1 - 2 * index / limit), np.pi * (1 + 5**0.5) * index
    directions = np.stack(
        [np.cos(azimuth) * np.sin(polar), np.sin(azimuth) * np.sin(polar), np.cos(polar)]
    )
    centred = (points - points.mean(axis=0)) / np.ptp(points, axis=0)
    return points[np.unique(np.argmax(centred @ directions, axis=0))]
