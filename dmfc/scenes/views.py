"""The depth images of a scene, rendered from its objects."""

from __future__ import annotations

from collections.abc import Mapping

from dmfc.config.scenes import ScenesConfig
from dmfc.objects.model import ObjectModel
from dmfc.scenes.scene_set import Scene
from dmfc.sensing.cameras import table_cameras
from dmfc.sensing.render import CameraView, open_renderer


def scene_views(
    config: ScenesConfig, scene: Scene, objects: Mapping[str, ObjectModel] | None
) -> list[CameraView]:
    """One view per camera; empty without `objects`."""
    if objects is None:
        return []
    cameras = table_cameras(config.cameras)
    renderer = open_renderer(config.cameras.renderer)
    try:
        models = [objects[name] for name in scene.object_ids]
        return renderer.render(cameras, models, scene.T_world_object, config.table_size)
    finally:
        renderer.close()
