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
from dmfc.sensing.cameras import Camera
from dmfc.sensing.render import CameraView, table_view

KEPT = 256  # acceleration structures; about 2 MB each for 16,000 triangles
KEPT_TABLES = 16


def probe() -> str:
    """Importing this module is the probe: nothing else can be missing."""
    return ""


def create() -> EmbreeRenderer:
    return EmbreeRenderer()


class EmbreeRenderer:
    """See `dmfc.sensing.render.Renderer`."""

    name = "embree"

    def __init__(self) -> None:
        self._scenes: OrderedDict[str, rtcore_scene.EmbreeScene] = OrderedDict()
        self._tables: dict[tuple, CameraView] = {}

    def render(
        self,
        cameras: Sequence[Camera],
        objects: Sequence[ObjectModel],
        T_world_object: np.ndarray,
        table_size: float,
    ) -> list[CameraView]:
        views = [self._empty(camera, table_size) for camera in cameras]
        for index, model in enumerate(objects):
            corners = transforms.apply(T_world_object[index], model.hull_vertices)
            for camera, view in zip(cameras, views, strict=True):
                window = _window_around(camera, corners)
                if window is not None:
                    self._cast(model, T_world_object[index], index, camera, view, window)
        return views

    def close(self) -> None:
        self._scenes.clear()

    def _cast(
        self,
        model: ObjectModel,
        T_world_object: np.ndarray,
        index: int,
        camera: Camera,
        view: CameraView,
        window: tuple[slice, slice],
    ) -> None:
        """Draw one object into a window of a view, where it is nearer than what is there."""
        assert view.face is not None
        R_object_world = T_world_object[:3, :3].T
        origin = R_object_world @ (camera.position - T_world_object[:3, 3])
        R_object_camera = R_object_world @ camera.T_world_camera[:3, :3]
        directions = camera.grid[window] @ R_object_camera.T
        directions = directions.reshape(-1, 3).astype(np.float32)
        origins = np.tile(origin.astype(np.float32), (len(directions), 1))
        hits = self._scene(model).run(origins, directions, output=True)
        old = view.depth[window]
        depth, face = hits["tfar"].reshape(old.shape), hits["primID"].reshape(old.shape)
        is_seen = (face >= 0) & ((old == 0) | (depth < old))
        np.copyto(old, depth, where=is_seen)
        np.copyto(view.object_index[window], np.int16(index), where=is_seen)
        np.copyto(view.face[window], face, where=is_seen)

    def _empty(self, camera: Camera, table_size: float) -> CameraView:
        """A fresh view of the empty table; its depth is kept, for cameras stay where they are."""
        key = (camera.T_world_camera.tobytes(), camera.width, camera.height, camera.focal)
        if (*key, table_size) not in self._tables:
            if len(self._tables) >= KEPT_TABLES:
                self._tables.clear()
            self._tables[*key, table_size] = table_view(camera, table_size)
        kept = self._tables[*key, table_size]
        faces = np.full(kept.depth.shape, -1, dtype=np.int32)
        return CameraView(kept.depth.copy(), kept.object_index.copy(), faces)

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


def _window_around(camera: Camera, points: np.ndarray) -> tuple[slice, slice] | None:
    """Rows and columns of the bounding rectangle of world points [n, 3]; None: out of the image."""
    image, depth = camera.project(points)
    if depth.min() <= 0:  # partly behind the camera: no rectangle bounds it
        return slice(0, camera.height), slice(0, camera.width)
    left, top = np.floor(image.min(0)).astype(int).clip(0)
    right = min(int(np.ceil(image[:, 0].max())), camera.width)
    bottom = min(int(np.ceil(image[:, 1].max())), camera.height)
    if left >= right or top >= bottom:
        return None
    return slice(top, bottom), slice(left, right)
