"""Collision between placed objects: their convex parts in FCL, and surface against solid."""

from __future__ import annotations

from dataclasses import dataclass

import fcl
import numpy as np
from scipy.spatial import ConvexHull

from dmfc.geometry import transforms
from dmfc.objects.model import ObjectModel

OVERLAP = 1e-4
"""Metres: how far a surface point may lie within a neighbour's signed-distance grid."""

_BOX_MARGIN = 0.005  # metres: convex parts may reach a little beyond the mesh


@dataclass
class _Placed:
    model: ObjectModel
    T_world_object: np.ndarray
    parts: fcl.DynamicAABBTreeCollisionManager
    box: np.ndarray
    """[2, 3] world axis-aligned bounds."""


class CollisionWorld:
    """Objects placed so far. Collision shapes are built once per object id and kept."""

    def __init__(self) -> None:
        self._shapes: dict[str, list[fcl.Convex]] = {}
        self._placed: list[_Placed] = []

    def clear(self) -> None:
        """Take all objects away; their shapes are kept."""
        self._placed = []

    def add(self, model: ObjectModel, T_world_object: np.ndarray) -> None:
        """Place an object, free or not. T_world_object: [4, 4]."""
        self._placed.append(self._place(model, T_world_object))

    def is_free(self, model: ObjectModel, T_world_object: np.ndarray) -> bool:
        """Whether the object would touch none of those placed.

        Both tests must pass: no two convex parts intersect, and no surface point of the one lies
        deeper than `OVERLAP` in the other (parts may have lost a little of the mesh).
        """
        new = self._place(model, T_world_object)
        return not any(_touch(new, other) for other in self._placed)

    def _place(self, model: ObjectModel, T_world_object: np.ndarray) -> _Placed:
        if model.id not in self._shapes:
            self._shapes[model.id] = [_convex(part) for part in model.convex_parts]
        pose = fcl.Transform(T_world_object[:3, :3], T_world_object[:3, 3])
        manager = fcl.DynamicAABBTreeCollisionManager()
        manager.registerObjects(
            [fcl.CollisionObject(shape, pose) for shape in self._shapes[model.id]]
        )
        manager.setup()
        vertices = transforms.apply(T_world_object, model.hull_vertices)
        corners = np.stack([vertices.min(0) - _BOX_MARGIN, vertices.max(0) + _BOX_MARGIN])
        return _Placed(model, T_world_object, manager, corners)


def overlap(a: ObjectModel, T_world_a: np.ndarray, b: ObjectModel, T_world_b: np.ndarray) -> float:
    """Depth, metres, of the surface points of each object within the other; 0 or less: apart."""
    T_b_a = transforms.inverse(T_world_b) @ T_world_a
    return max(_depth(a, b, T_b_a), _depth(b, a, transforms.inverse(T_b_a)))


def _depth(a: ObjectModel, b: ObjectModel, T_b_a: np.ndarray) -> float:
    """Depth of the surface points of a in b; those beyond b's grid are outside."""
    points = transforms.apply(T_b_a, a.surface_points.astype(np.float64))
    near = ((points >= b.sdf.origin) & (points <= b.sdf.upper)).all(1)
    return float(b.sdf.distance(points[near]).max(initial=-np.inf))


def _touch(a: _Placed, b: _Placed) -> bool:
    if (a.box[0] > b.box[1]).any() or (b.box[0] > a.box[1]).any():
        return False
    data = fcl.CollisionData()
    a.parts.collide(b.parts, data, fcl.defaultCollisionCallback)
    if data.result.is_collision:
        return True
    return overlap(a.model, a.T_world_object, b.model, b.T_world_object) > OVERLAP


def _convex(points: np.ndarray) -> fcl.Convex:
    """The hull of points [n, 3] as an FCL shape, its faces wound outwards."""
    hull = ConvexHull(points)
    used, inverse = np.unique(hull.simplices, return_inverse=True)
    vertices = np.asarray(points, dtype=np.float64)[used]
    faces = inverse.reshape(hull.simplices.shape)
    first, second, third = (vertices[faces[:, k]] for k in range(3))
    normals = np.cross(second - first, third - first)
    is_inward = (normals * hull.equations[:, :3]).sum(1) < 0
    faces[is_inward] = faces[is_inward][:, ::-1]
    flat = np.concatenate([np.full((len(faces), 1), 3), faces], axis=1).reshape(-1)
    return fcl.Convex(vertices, len(faces), flat)
