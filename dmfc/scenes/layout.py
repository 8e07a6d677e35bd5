"""Which objects stand where: one object in a stable pose, or several free of collision.

Scene i of a set depends on (seed, i), the list of object ids and the objects alone: not on the
scenes before it, nor on the shard it is made in.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from dmfc.config.scenes import ScenesConfig, SceneSetConfig
from dmfc.errors import DmfcError
from dmfc.objects.model import ObjectModel
from dmfc.scenes.placement import CollisionWorld

_ORDER, _COUNT, _POSE = range(3)  # independent random streams of one seed
_BLOCK = 1024  # scenes whose object counts are drawn at once


@dataclass(frozen=True)
class Layout:
    """Objects of a scene and their poses on the table."""

    scene: int
    object_ids: list[str]
    T_world_object: np.ndarray
    """[k, 4, 4]."""


def choose_objects(scenes: SceneSetConfig, object_ids: Sequence[str], scene: int) -> list[str]:
    """Ids of the objects of scene number `scene`.

    The set deals the objects from shuffled decks, one deck after the other, so that all appear
    about equally often; no object is twice in a scene unless the list is shorter than the scene.
    Raises DmfcError if there are no objects.
    """
    if not object_ids:
        raise DmfcError("no objects to make scenes of (settings objects.train, objects.test)")
    ids = sorted(object_ids)
    start, wanted = _span(scenes, scene)
    chosen: list[int] = []
    position, last = start, start + wanted + len(ids)
    while len(chosen) < wanted:
        deck, card = divmod(position, len(ids))
        number = int(_deck(scenes.seed, len(ids), deck)[card])
        if number not in chosen or position >= last:
            chosen.append(number)
        position += 1
    return [ids[number] for number in chosen]


def make_layout(
    config: ScenesConfig,
    scenes: SceneSetConfig,
    objects: Mapping[str, ObjectModel],
    scene: int,
    world: CollisionWorld | None = None,
) -> Layout:
    """Scene number `scene` of the set: objects placed one by one at random until free of collision.

    `world` holds collision shapes that are kept from scene to scene. Raises DmfcError if an object
    finds no place (settings scenes.table_size, scenes.spawn_radius).
    """
    world = world or CollisionWorld()
    world.clear()
    chosen = choose_objects(scenes, list(objects), scene)
    generator = _generator(scenes.seed, _POSE, scene)
    poses = []
    for object_id in chosen:
        model = objects[object_id]
        for attempt in range(config.place_attempts):
            reach = _reach(config, scenes, attempt)
            T_world_object = _draw_pose(model, scenes.kind, reach, generator)
            if _on_table(model, T_world_object, config) and world.is_free(model, T_world_object):
                break
        else:
            raise DmfcError(
                f"scene {scene}: no free place for '{object_id}' in {config.place_attempts} "
                "attempts (settings scenes.table_size, scenes.spawn_radius, scenes.place_attempts)"
            )
        world.add(model, T_world_object)
        poses.append(T_world_object)
    return Layout(scene, chosen, np.stack(poses))


def _span(scenes: SceneSetConfig, scene: int) -> tuple[int, int]:
    """How many objects the scenes before this one hold, and how many this one does."""
    if scenes.kind != "multi":
        return scene, 1
    if not 1 <= scenes.min_objects <= scenes.max_objects:
        raise DmfcError(
            f"a multi scene cannot hold {scenes.min_objects} to {scenes.max_objects} objects "
            "(settings min_objects, max_objects)"
        )
    blocks, place = divmod(scene, _BLOCK)
    bounds = (scenes.min_objects, scenes.max_objects)
    counts = _counts(scenes.seed, *bounds, blocks)
    before = sum(int(_counts(scenes.seed, *bounds, block).sum()) for block in range(blocks))
    return before + int(counts[:place].sum()), int(counts[place])


@lru_cache
def _counts(seed: int, fewest: int, most: int, block: int) -> np.ndarray:
    return _generator(seed, _COUNT, block).integers(fewest, most + 1, _BLOCK)


@lru_cache
def _deck(seed: int, size: int, number: int) -> np.ndarray:
    return _generator(seed, _ORDER, number).permutation(size)


def _reach(config: ScenesConfig, scenes: SceneSetConfig, attempt: int) -> float:
    """Radius for an attempt: it grows to the table's edge over the second half of the attempts,
    so that large objects find room beside each other."""
    half = config.place_attempts / 2
    late = max(0.0, attempt / half - 1)
    return config.spawn_radius + late * max(0.0, config.table_size / 2 - config.spawn_radius)


def _draw_pose(
    model: ObjectModel, kind: str, reach: float, generator: np.random.Generator
) -> np.ndarray:
    """T_world_object [4, 4]: a stable pose, any yaw, the middle of the footprint within `reach`."""
    weights = model.stable_probabilities / model.stable_probabilities.sum()
    drawn = int(generator.choice(len(weights), p=weights))
    pose = model.standard_pose if kind == "single_standard" else drawn
    yaw, angle = generator.uniform(-np.pi, np.pi, 2)
    radius = reach * np.sqrt(generator.uniform())
    cos, sin = np.cos(yaw), np.sin(yaw)
    rotation = np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]]) @ model.stable_rotations[pose]
    footprint = model.hull_vertices @ rotation[:2].T
    middle = (footprint.min(0) + footprint.max(0)) / 2
    T_world_object = np.eye(4)
    T_world_object[:3, :3] = rotation
    T_world_object[:2, 3] = radius * np.array([np.cos(angle), np.sin(angle)]) - middle
    T_world_object[2, 3] = model.rest_heights[pose]
    return T_world_object


def _on_table(model: ObjectModel, T_world_object: np.ndarray, config: ScenesConfig) -> bool:
    footprint = model.hull_vertices @ T_world_object[:2, :3].T + T_world_object[:2, 3]
    return bool(np.abs(footprint).max() <= config.table_size / 2)


def _generator(seed: int, *key: int) -> np.random.Generator:
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=key))
