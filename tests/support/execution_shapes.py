"""Scenes of one or two simple objects on a table, and the runner of their trials."""

from __future__ import annotations

from functools import cache

import numpy as np

from dmfc.config.execution import ExecutionConfig
from dmfc.config.physics import PhysicsConfig
from dmfc.execution.trial import TrialRunner
from dmfc.objects.model import ObjectModel
from dmfc.physics.world import World
from dmfc.scenes.scene_set import Scene
from tests.support.grasp_shapes import planned, shadow, shape
from tests.support.physics_shapes import pose


def standing(name: str, x: float = 0.0, y: float = 0.0, turn: float = 0.0) -> np.ndarray:
    """T_world_object of an object that stands on the table."""
    return pose(x, y, float(shape(name).stable_heights[0]), (0, 0, turn))


def runner(
    models: list[ObjectModel],
    T_world_object: list[np.ndarray],
    physics: PhysicsConfig | None = None,
    config: ExecutionConfig | None = None,
) -> TrialRunner:
    hand, description = shadow()
    world = World(description, models, physics or PhysicsConfig(), table_size=2.0)
    return TrialRunner(world, hand, np.array(T_world_object), config or ExecutionConfig())


@cache
def good(name: str) -> list[int]:
    """Rows of the planned set that are held in the default protocol."""
    trials, T, grasps = runner([shape(name)], [standing(name)]), standing(name), planned(name)
    return [
        row
        for row in range(len(grasps))
        if trials.run(T @ grasps.T_object_palm[row], grasps.joints[row], 0).held
    ]


def scene_of(
    number: int,
    names: list[str],
    T_world_object: list[np.ndarray],
    labels: list[tuple[int, int]],
    points: int = 300,
) -> Scene:
    """A scene with `labels` (object, grasp) and the whole surface of its objects as its cloud."""
    generator = np.random.default_rng(number)
    owner = generator.integers(len(names), size=points)
    cloud, normals = np.zeros((points, 3)), np.zeros((points, 3))
    for k, (name, T) in enumerate(zip(names, T_world_object, strict=True)):
        rows = generator.integers(len(shape(name).surface_points), size=points)
        own = owner == k
        cloud[own] = (shape(name).surface_points[rows] @ T[:3, :3].T + T[:3, 3])[own]
        normals[own] = (shape(name).surface_normals[rows] @ T[:3, :3].T)[own]
    table = np.array(labels, dtype=np.int64).reshape(-1, 2)
    return Scene(
        scene=number,
        object_ids=[shape(name).id for name in names],
        T_world_object=np.array(T_world_object),
        points=cloud.astype(np.float32),
        normals=normals.astype(np.float32),
        point_object=owner.astype(np.uint8),
        point_camera=np.zeros(points, np.uint8),
        grasp_object=table[:, 0].astype(np.uint8),
        grasp_index=table[:, 1].astype(np.int32),
        dropped={"table": 0, "neighbour": 0, "limit": 0},
    )
