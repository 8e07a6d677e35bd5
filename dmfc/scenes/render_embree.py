"""Depth by ray casting with Embree: one acceleration structure per object, kept between scenes.

Only the pixels in an object's bounding rectangle are cast, in the object's own frame. The ray of a
pixel is scaled to unit depth, so that Embree's hit parameter is the depth.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Sequence

import numpy as np
from embreex import rtcore_scene
from embreex.mesh_construction import TriangleMesh

from dmfc.geometry import transforms
from dmfc.objects.model import ObjectModel
from dmfc.scenes.cameras import Camera
from dmfc.scenes.render import NOTHING, TABLE, View

KEPT = 256  # acceleration structures; about 2 MB each for 16,000 triangles
KEPT_TABLES = 16


def probe() -> str:
    """Importing this module is the probe: nothing else can be missing."""
    return ""


def create() -> EmbreeRenderer:
    return EmbreeRenderer()


class EmbreeRenderer:
    """See `dmfc.scenes.render.Renderer`."""

    name = "embree"

    def __init__(self) -> None:
        self._scenes: OrderedDict[str, rtcore_scene.EmbreeScene] = OrderedDict()
        self._tables: dict[tuple, View] = {}

    def render(
        self,
        cameras: Sequence[Camera],
        objects: Sequence[ObjectModel],
        T_world_object: np.ndarray,
        table_size: float,
    ) -> list[View]:
        views = [self._empty(camera, table_size) for camera in cameras]
        for index, model in enumerate(objects):
            corners = transforms.apply(T_world_object[index], model.vertices)
            for camera, view in zip(cameras, views, strict=True):
                pixels = _pixels_around(camera, corners)
                if pixels is not None:
                    self._cast(model, T_world_object[index], index, camera, view, *pixels)
        return views

    def close(self) -> None:
        self._scenes.clear()

    def _cast(
        self,
        model: ObjectModel,
        T_world_object: np.ndarray,
        index: int,
        camera: Camera,
        view: View,
        rows: np.ndarray,
        columns: np.ndarray,
    ) -> None:
        """Draw one object into a view, where it is nearer than what is there."""
        rotation = T_world_object[:3, :3]
        origin = (camera.position - T_world_object[:3, 3]) @ rotation
        directions = (camera.rays(rows, columns) @ rotation).astype(np.float32)
        origins = np.broadcast_to(origin.astype(np.float32), directions.shape)
        hits = self._scene(model).run(np.ascontiguousarray(origins), directions, output=True)
        depth = hits["tfar"]
        old = view.depth[rows, columns]
        is_seen = (hits["primID"] >= 0) & ((old == 0) | (depth < old))
        rows, columns = rows[is_seen], columns[is_seen]
        view.depth[rows, columns] = depth[is_seen]
        view.object_index[rows, columns] = index
        assert view.face is not None
        view.face[rows, columns] = hits["primID"][is_seen]

    def _empty(self, camera: Camera, table_size: float) -> View:
        """A fresh view of the empty table; its depth is kept, for cameras stay where they are."""
        key = (camera.T_world_camera.tobytes(), camera.width, camera.height, camera.focal)
        if (*key, table_size) not in self._tables:
            if len(self._tables) >= KEPT_TABLES:
                self._tables.clear()
            self._tables[*key, table_size] = _table_view(camera, table_size)
        kept = self._tables[*key, table_size]
        faces = np.full(kept.depth.shape, -1, dtype=np.int32)
        return View(kept.depth.copy(), kept.object_index.copy(), faces)

    def _scene(self, model: ObjectModel) -> rtcore_scene.EmbreeScene:
        """Acceleration structure of an object, in its own frame; the oldest is let go."""
        if model.id not in self._scenes:
            scene = rtcore_scene.EmbreeScene()
            TriangleMesh(scene, np.ascontiguousarray(model.vertices[model.faces], dtype=np.float32))
            self._scenes[model.id] = scene
            if len(self._scenes) > KEPT:
                self._scenes.popitem(last=False)
        self._scenes.move_to_end(model.id)
        return self._scenes[model.id]


def _table_view(camera: Camera, table_size: float) -> View:
    """The empty table, in closed form."""
    rows, columns = np.indices((camera.height, camera.width)).reshape(2, -1)
    rays = camera.rays(rows, columns)
    depth = -camera.position[2] / np.minimum(rays[:, 2], -1e-9)
    places = camera.position[:2] + depth[:, None] * rays[:, :2]
    is_table = (np.abs(places) <= table_size / 2).all(1) & (rays[:, 2] < 0)
    shape = (camera.height, camera.width)
    return View(
        np.where(is_table, depth, 0).reshape(shape).astype(np.float32),
        np.where(is_table, TABLE, NOTHING).reshape(shape).astype(np.int16),
        None,
    )


def _pixels_around(camera: Camera, points: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
    """Rows and columns [n] of the bounding rectangle of world points; None if out of the image."""
    image, depth = camera.project(points)
    if depth.min() <= 0:  # partly behind the camera: the rectangle is not bounded by its corners
        left, top, right, bottom = 0, 0, camera.width, camera.height
    else:
        left, top = np.floor(image.min(0)).astype(int).clip(0)
        right = min(int(np.ceil(image[:, 0].max())), camera.width)
        bottom = min(int(np.ceil(image[:, 1].max())), camera.height)
    if left >= right or top >= bottom:
        return None
    rows, columns = np.mgrid[top:bottom, left:right].reshape(2, -1)
    return rows, columns
