"""Scenes from objects: layout, depth images, cloud, labels; and shards of them."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from dmfc.config.scenes import ScenesConfig, SceneSetConfig
from dmfc.engine.stage import plain
from dmfc.errors import DmfcError
from dmfc.grasps.grasp_set import GraspSet
from dmfc.hand.model import HandModel
from dmfc.objects.model import ObjectModel
from dmfc.scenes.augment import kept_points, sensor_errors
from dmfc.scenes.labels import REASONS, HandAtGrasps, Labels, surviving_labels
from dmfc.scenes.layout import make_layout
from dmfc.scenes.placement import CollisionWorld
from dmfc.scenes.scene_set import Scene, write_shard
from dmfc.sensing.cameras import table_cameras
from dmfc.sensing.cloud import Cloud, fuse_pixels, fuse_views
from dmfc.sensing.depth import object_pixels
from dmfc.sensing.image_errors import observed_views, seen_at_an_angle, with_table
from dmfc.sensing.render import CameraView, Renderer, open_renderer

Progress = Callable[[float, str], None]
_CLOUD, _SENSOR, _IMAGES = (
    3,
    4,
    5,
)  # random streams of a scene, beside those of `dmfc.scenes.layout`


def make_scene_file(
    config: ScenesConfig,
    scenes: SceneSetConfig,
    numbers: range,
    objects: Mapping[str, ObjectModel],
    grasps: Mapping[str, GraspSet] | None,
    hand: HandModel | None,
    out: Path,
    progress: Progress = lambda fraction, message: None,
) -> dict[str, int]:
    """Make the scenes `numbers` of a set and write them to the file `out`; returns counts.

    `objects` names all objects of the set; only those in these scenes are looked up, so a mapping
    that loads on demand will do. Without `grasps` the scenes have no labels; with them, `hand` is
    needed. The bytes depend on settings and inputs alone. Raises DmfcError if a scene cannot be
    made, or the file not written.
    """
    if grasps is not None and hand is None:
        raise DmfcError("scenes with labels need the hand, to drop grasps in collision")
    made = []
    with SceneMaker(config, scenes, objects, grasps, hand) as maker:
        for done, number in enumerate(numbers, start=1):
            made.append(maker.make(number))
            progress(done / len(numbers), f"scene {number}")
        renderer = maker.renderer.name
    manifest = {
        # As in keys: a setting that came later is there where it is not at its default.
        "set": {name: value for name, value in plain(scenes).items() if name != "count"},
        "scenes": _without(config, "train", "test", "shard_size", "augmentation"),
        "numbers": [numbers.start, numbers.stop],
        "renderer": renderer,
        "objects": {i: objects[i].mesh_sha256 for scene in made for i in scene.object_ids},
        "hand": hand.name if hand else "",
    }
    write_shard(out, made, manifest)
    counts = {"scenes": len(made), "grasps": sum(len(scene.grasp_index) for scene in made)}
    return counts | {
        f"dropped_{reason}": sum(scene.dropped[reason] for scene in made) for reason in REASONS
    }


class SceneMaker:
    """Makes single scenes; keeps what can be kept from one to the next. Close it after use."""

    def __init__(
        self,
        config: ScenesConfig,
        scenes: SceneSetConfig,
        objects: Mapping[str, ObjectModel],
        grasps: Mapping[str, GraspSet] | None = None,
        hand: HandModel | None = None,
    ) -> None:
        self.config = config
        self.scenes = scenes
        self.objects = objects
        self.cameras = table_cameras(config.cameras)
        self.renderer: Renderer = open_renderer(config.cameras.renderer)
        self._grasps = grasps
        self._world = CollisionWorld()
        self._hand = HandAtGrasps(hand) if hand is not None else None

    def make(self, number: int) -> Scene:
        """Scene `number` of the set: the same whatever was made before."""
        layout = make_layout(self.config, self.scenes, self.objects, number, self._world)
        models = [self.objects[object_id] for object_id in layout.object_ids]
        T_world_object = layout.T_world_object
        views = self.views(models, T_world_object)
        seeds = np.random.SeedSequence(self.scenes.seed, spawn_key=(_CLOUD, number))
        generator = np.random.default_rng(seeds)
        cloud = self._observed(
            self._fused(views, models, T_world_object, number, generator), number
        )
        if self._grasps is None or self._hand is None:
            none = np.zeros(0)
            labels = Labels(none.astype(np.uint8), none.astype(np.int32), dict.fromkeys(REASONS, 0))
        else:
            labels = surviving_labels(self.config, models, T_world_object, self._grasps, self._hand)
        return Scene(
            scene=number,
            object_ids=layout.object_ids,
            T_world_object=T_world_object,
            **_fields(cloud),
            **_fields(labels),
        )

    def _fused(
        self,
        views: Sequence[CameraView],
        models: Sequence[ObjectModel],
        T_world_object: np.ndarray,
        number: int,
        generator: np.random.Generator,
    ) -> Cloud:
        """The cloud of the images, with the errors that the set's cameras have in them."""
        sensor, count = self.scenes.sensor, self.config.points
        if not sensor.in_images:
            return fuse_views(views, self.cameras, models, T_world_object, count, generator)
        seeds = np.random.SeedSequence(self.scenes.seed, spawn_key=(_IMAGES, number))
        errors = np.random.default_rng(seeds)
        views = observed_views(sensor, views, errors)
        given = (self.cameras, models, T_world_object)
        pixels = seen_at_an_angle(sensor, object_pixels(views), *given, errors)
        cloud = fuse_pixels(pixels, *given, count, generator)
        return with_table(sensor, cloud, views, self.cameras, errors)

    def _observed(self, cloud: Cloud, number: int) -> Cloud:
        """The cloud with the errors of the set's cameras."""
        sensor = self.scenes.sensor
        if not sensor.in_points:
            return cloud
        seeds = np.random.SeedSequence(self.scenes.seed, spawn_key=(_SENSOR, number))
        generator = np.random.default_rng(seeds)
        positions = np.stack([camera.position for camera in self.cameras])
        points, normals = sensor_errors(
            sensor, cloud.points, cloud.normals, cloud.point_camera, positions, generator
        )
        kept = kept_points(sensor, len(points), generator)
        return Cloud(
            points[kept].astype(np.float32),
            normals[kept].astype(np.float32),
            cloud.point_object[kept],
            cloud.point_camera[kept],
        )

    def views(self, models: Sequence[ObjectModel], T_world_object: np.ndarray) -> list[CameraView]:
        """The depth images of objects at T_world_object [k, 4, 4], one per camera."""
        return self.renderer.render(self.cameras, models, T_world_object, self.config.table_size)

    def close(self) -> None:
        self.renderer.close()

    def __enter__(self) -> SceneMaker:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()


def _without(config: Any, *names: str) -> dict[str, Any]:
    return {k: v for k, v in dataclasses.asdict(config).items() if k not in names}


def _fields(record: Any) -> dict[str, Any]:
    return {entry.name: getattr(record, entry.name) for entry in dataclasses.fields(record)}
