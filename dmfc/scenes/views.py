"""The depth images of a scene: decoded where they are kept, rendered anew where they are not."""

from __future__ import annotations

from collections.abc import Mapping

from dmfc.config.scenes import ScenesConfig
from dmfc.objects.model import ObjectModel
from dmfc.scenes.scene_set import Scene
from dmfc.sensing.cameras import table_cameras
from dmfc.sensing.depth import decode, views_of
from dmfc.sensing.render import View, open_renderer


def scene_views(
    config: ScenesConfig, scene: Scene, objects: Mapping[str, ObjectModel] | None
) -> list[View]:
    """One view per camera; empty if images are neither kept nor can be rendered, for lack of
    `objects`."""
    cameras = table_cameras(config.cameras)
    if scene.depth:
        return views_of(decode(scene.depth)[0], cameras, config.table_size)
    if objects is None:
        return []
    renderer = open_renderer(config.cameras.renderer)
    try:
        models = [objects[name] for name in scene.object_ids]
        return renderer.render(cameras, models, scene.T_world_object, config.table_size)
    finally:
        renderer.close()
