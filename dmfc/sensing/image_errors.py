"""Errors of depth images before they are fused: what is cut off, mixed, lost or taken for objects.

Each is a simple model of its own, after what real cameras are known to do: pixels at depth edges
mix both sides ("flying pixels"), steep surfaces send nothing back, masks of objects are a few
pixels too wide or too narrow, and the table is not removed everywhere.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import ndimage
from scipy.spatial import cKDTree

from dmfc.config.scenes import SensorConfig
from dmfc.objects.model import ObjectModel
from dmfc.sensing.cameras import Camera
from dmfc.sensing.cloud import Cloud, surface
from dmfc.sensing.depth import ObjectPixels
from dmfc.sensing.render import NOTHING, TABLE, CameraView

EDGE = 0.01
"""m between two neighbouring pixels that lie on two surfaces."""
AROUND = 0.05
"""m from the objects within which the table is left in."""


def observed_views(
    config: SensorConfig, views: Sequence[CameraView], generator: np.random.Generator
) -> list[CameraView]:
    """The images as cameras with these errors give them; the given ones stay as they are."""
    return [
        _mixed(config, _masked(config, _cropped(config, view, number)), generator)
        for number, view in enumerate(views)
    ]


def seen_at_an_angle(
    config: SensorConfig,
    pixels: ObjectPixels,
    cameras: Sequence[Camera],
    objects: Sequence[ObjectModel],
    T_world_object: np.ndarray,
    generator: np.random.Generator,
) -> ObjectPixels:
    """The pixels that send something back.

    Where ray and surface form the angle a below `config.grazing`, one is lost with probability
    1 - a / grazing.
    """
    if config.grazing == 0 or not len(pixels):
        return pixels
    _, normals = surface(pixels, cameras, objects, T_world_object)
    _, towards = pixels.points(cameras)
    length = np.linalg.norm(towards, axis=1) * np.linalg.norm(normals, axis=1)
    sine = np.abs((normals * towards).sum(axis=1)) / np.maximum(length, 1e-30)
    angle = np.arcsin(np.clip(sine, 0, 1))
    kept = generator.uniform(size=len(pixels)) >= 1 - angle / config.grazing
    return pixels[np.flatnonzero(kept)]


def with_table(
    config: SensorConfig,
    cloud: Cloud,
    views: Sequence[CameraView],
    cameras: Sequence[Camera],
    generator: np.random.Generator,
) -> Cloud:
    """The cloud with the share `config.table` of its points taken from the table around it.

    A point of the table counts to the object nearest to it. Where no camera sees table there, the
    cloud stays as it is.
    """
    count = round(config.table * len(cloud.points))
    found, camera = _table_points(views, cameras)
    if not count or not len(found):
        return cloud
    distance, nearest = cKDTree(cloud.points).query(found, distance_upper_bound=AROUND)
    near = np.flatnonzero(np.isfinite(distance))
    if not len(near):
        return cloud
    rows = generator.choice(len(cloud.points), count, replace=False)
    taken = generator.choice(near, count, replace=count > len(near))
    points, normals = cloud.points.copy(), cloud.normals.copy()
    owner, seen_by = cloud.point_object.copy(), cloud.point_camera.copy()
    points[rows], normals[rows] = found[taken], [0.0, 0.0, 1.0]
    owner[rows] = cloud.point_object[nearest[taken]]
    seen_by[rows] = camera[taken]
    return Cloud(points, normals, owner, seen_by)


def _table_points(
    views: Sequence[CameraView], cameras: Sequence[Camera]
) -> tuple[np.ndarray, np.ndarray]:
    """World points [M, 3] of the pixels that show the table, and the camera of each."""
    points, numbers = [np.zeros((0, 3))], [np.zeros(0, dtype=np.uint8)]
    for number, (view, camera) in enumerate(zip(views, cameras, strict=True)):
        rows, columns = np.nonzero(view.object_index == TABLE)
        depth = view.depth[rows, columns, None].astype(np.float64)
        points.append(camera.position + depth * camera.rays(rows, columns))
        numbers.append(np.full(len(rows), number, dtype=np.uint8))
    return np.concatenate(points), np.concatenate(numbers)


def _cropped(config: SensorConfig, view: CameraView, number: int) -> CameraView:
    """Nothing at the sides of the image, and nothing at all of a camera that is not there."""
    height, width = view.depth.shape
    if number not in config.cameras:
        top, left = height, width
    else:
        top, left = round(config.crop * height / 2), round(config.crop * width / 2)
    inside = np.zeros((height, width), dtype=bool)
    inside[top : height - top, left : width - left] = True
    return CameraView(
        np.where(inside, view.depth, 0).astype(view.depth.dtype),
        np.where(inside, view.object_index, NOTHING).astype(view.object_index.dtype),
        view.face,
    )


def _masked(config: SensorConfig, view: CameraView) -> CameraView:
    """Masks of objects that are wider (or narrower) by `config.mask` pixels."""
    if config.mask == 0:
        return view
    size = 2 * abs(config.mask) + 1
    index, depth = view.object_index, view.depth
    if config.mask > 0:
        widest = ndimage.maximum_filter(index, size, mode="nearest")
        changed = np.where((index == TABLE) & (widest >= 0), widest, index)
    else:
        lowest = ndimage.minimum_filter(index, size, mode="nearest")
        changed = np.where((index >= 0) & (lowest < 0), TABLE, index)
    face = None if view.face is None else np.where(changed == index, view.face, -1)
    return CameraView(depth, changed.astype(index.dtype), face)


def _mixed(config: SensorConfig, view: CameraView, generator: np.random.Generator) -> CameraView:
    """Depth of object pixels up to `config.bleeding` pixels from a depth edge: a random mix of
    their own and of what is farthest within that distance."""
    if config.bleeding == 0:
        return view
    farthest = ndimage.maximum_filter(view.depth, 2 * config.bleeding + 1, mode="nearest")
    gap = farthest - view.depth
    share = generator.uniform(size=view.depth.shape)
    mixed = (view.object_index >= 0) & (gap > EDGE)
    depth = np.where(mixed, view.depth + share * gap, view.depth)
    return CameraView(depth.astype(view.depth.dtype), view.object_index, view.face)
