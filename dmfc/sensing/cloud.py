"""Depth images -> one cloud: back-projected, background removed, fused, reduced to N points."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import igl
import numpy as np

from dmfc.errors import DmfcError
from dmfc.geometry import transforms
from dmfc.geometry.points import choose
from dmfc.objects.model import ObjectModel
from dmfc.sensing.cameras import Camera
from dmfc.sensing.depth import ObjectPixels, object_pixels
from dmfc.sensing.render import CameraView


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
    views: Sequence[CameraView],
    cameras: Sequence[Camera],
    objects: Sequence[ObjectModel],
    T_world_object: np.ndarray,
    count: int,
    generator: np.random.Generator,
) -> Cloud:
    """`count` points of the object pixels of all views, each at most once if there are enough.

    T_world_object: [k, 4, 4]. Raises DmfcError if no object is in sight.
    """
    return fuse_pixels(object_pixels(views), cameras, objects, T_world_object, count, generator)


def fuse_pixels(
    pixels: ObjectPixels,
    cameras: Sequence[Camera],
    objects: Sequence[ObjectModel],
    T_world_object: np.ndarray,
    count: int,
    generator: np.random.Generator,
) -> Cloud:
    """As `fuse_views`, from the pixels that show an object."""
    if len(pixels) == 0:
        raise DmfcError(
            "no object is in sight of any camera (settings scenes.cameras, scenes.spawn_radius, "
            "sensor.* of the set)"
        )
    chosen = pixels[choose(len(pixels), count, generator)]
    points, normals = surface(chosen, cameras, objects, T_world_object)
    return Cloud(
        points.astype(np.float32),
        normals.astype(np.float32),
        chosen.object_index.astype(np.uint8),
        chosen.camera.astype(np.uint8),
    )


def surface(
    pixels: ObjectPixels,
    cameras: Sequence[Camera],
    objects: Sequence[ObjectModel],
    T_world_object: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """World points and outward unit normals [M, 3] of pixels.

    The normal is that of the triangle that was hit (or, where the renderer does not know it, of the
    nearest one), turned towards the camera: what a camera sees is an outside.
    """
    points, towards = pixels.points(cameras)
    index, faces = pixels.object_index.astype(np.int64), pixels.face.astype(np.int64)
    normals = _normals(points, index, faces, objects, T_world_object)
    return points, normals * np.where((normals * towards).sum(1, keepdims=True) < 0, -1, 1)


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
