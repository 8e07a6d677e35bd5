"""Depth images -> one cloud: back-projected, background removed, fused, reduced to N points."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import igl
import numpy as np

from dmfc.errors import DmfcError
from dmfc.geometry import transforms
from dmfc.objects.model import ObjectModel
from dmfc.scenes.cameras import Camera
from dmfc.scenes.render import View


@dataclass(frozen=True)
class Cloud:
    """Points of the objects of a scene, world frame, in random order."""

    points: np.ndarray
    """[N, 3] float32, metres."""
    normals: np.ndarray
    """[N, 3] float32, outward, unit length."""
    point_object: np.ndarray
    """[N] uint8: index of the object in the scene."""
    point_camera: np.ndarray
    """[N] uint8: the camera that saw the point."""


def fuse_views(
    views: Sequence[View],
    cameras: Sequence[Camera],
    objects: Sequence[ObjectModel],
    T_world_object: np.ndarray,
    count: int,
    generator: np.random.Generator,
) -> Cloud:
    """`count` points of the object pixels of all views, each at most once if there are enough.

    T_world_object: [k, 4, 4]. The normal is that of the triangle that was hit (or, where the
    renderer does not know it, of the nearest one), turned towards the camera: what a camera sees is
    an outside. Raises DmfcError if no object is in sight.
    """
    seen = [np.argwhere(view.object_index >= 0) for view in views]
    sizes = np.array([len(pixels) for pixels in seen])
    if sizes.sum() == 0:
        raise DmfcError(
            "no object is in sight of any camera (settings scenes.cameras, scenes.spawn_radius)"
        )
    chosen = _choose(int(sizes.sum()), count, generator)
    camera_of = np.repeat(np.arange(len(views)), sizes)[chosen]
    rows, columns = np.concatenate(seen)[chosen].T
    points, towards = np.empty((count, 3)), np.empty((count, 3))
    index, faces = np.empty(count, dtype=np.int64), np.full(count, -1)
    for number, (camera, view) in enumerate(zip(cameras, views, strict=True)):
        mine = camera_of == number
        place = rows[mine], columns[mine]
        rays = camera.rays(*place)
        points[mine] = camera.position + view.depth[place][:, None].astype(np.float64) * rays
        towards[mine] = -rays
        index[mine] = view.object_index[place]
        if view.face is not None:
            faces[mine] = view.face[place]
    normals = _normals(points, index, faces, objects, T_world_object)
    normals *= np.where((normals * towards).sum(1, keepdims=True) < 0, -1, 1)
    return Cloud(
        points.astype(np.float32),
        normals.astype(np.float32),
        index.astype(np.uint8),
        camera_of.astype(np.uint8),
    )


def _choose(available: int, count: int, generator: np.random.Generator) -> np.ndarray:
    """`count` of `available` indices in random order; all of them, then repeats, if too few."""
    if available >= count:
        return generator.choice(available, count, replace=False)
    repeats = generator.choice(available, count - available)
    return generator.permutation(np.concatenate([np.arange(available), repeats]))


def _normals(
    points: np.ndarray,
    index: np.ndarray,
    faces: np.ndarray,
    objects: Sequence[ObjectModel],
    T_world_object: np.ndarray,
) -> np.ndarray:
    """World normals [N, 3] of the triangles that points [N, 3] lie on; face -1: the nearest."""
    normals = np.zeros_like(points)
    for number, model in enumerate(objects):
        mine = np.flatnonzero(index == number)
        T = T_world_object[number]
        unknown = mine[faces[mine] < 0]
        if len(unknown):
            local = transforms.apply(transforms.inverse(T), points[unknown])
            vertices = np.ascontiguousarray(model.vertices, dtype=np.float64)
            nearest = igl.point_mesh_squared_distance(local, vertices, model.faces)[1]
            faces[unknown] = np.asarray(nearest).reshape(-1)
        corners = model.vertices[model.faces[faces[mine]]]
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        length = np.linalg.norm(normal, axis=1, keepdims=True)
        normals[mine] = transforms.rotate(T, normal / np.maximum(length, 1e-30))
    return normals
