"""A contact sheet of grasps: a row per object, the hand at a few of its grasps."""

from __future__ import annotations

from collections.abc import Iterable

import mujoco
import numpy as np
from PIL import Image

from dmfc.config.physics import PhysicsConfig
from dmfc.geometry.points import farthest_points
from dmfc.grasps.grasp_set import GraspSet
from dmfc.hand.description import HandDescription
from dmfc.objects.model import ObjectModel
from dmfc.physics.world import World
from dmfc.visualization.simulation import Camera, strip


def contact_sheet(
    pairs: Iterable[tuple[ObjectModel, GraspSet]],
    description: HandDescription,
    physics: PhysicsConfig,
    columns: int = 8,
    size: int = 220,
) -> Image.Image:
    """Frames of `size` pixels; the grasps shown are those whose palms lie farthest apart.

    An object without grasps is shown alone. Needs GL (see `dmfc.visualization.simulation.Camera`).
    """
    rows = [_row(model, grasps, description, physics, columns, size) for model, grasps in pairs]
    sheet = Image.new("RGB", (columns * size, len(rows) * size), "white")
    for number, row in enumerate(rows):
        sheet.paste(row, (0, number * size))
    return sheet


def _row(
    model: ObjectModel,
    grasps: GraspSet,
    description: HandDescription,
    physics: PhysicsConfig,
    columns: int,
    size: int,
) -> Image.Image:
    world = World(description, [model], physics, visual=True)
    T_world_object = np.eye(4)
    T_world_object[:3, 3] = -model.com
    world.place_object(0, T_world_object)
    shown = farthest_points(grasps.position, min(columns, len(grasps))) if len(grasps) else [None]
    frames: list[np.ndarray] = []
    labels: list[str] = []
    with Camera(world, size, size, look_at=(0.0, 0.0, 0.0), distance=0.55) as camera:
        for grasp in shown:
            T = T_world_object.copy()
            if grasp is not None:
                T = T @ grasps.T_object_palm[grasp]
                world.place_palm(T, grasps.joints[grasp])
            mujoco.mj_forward(world.model, world.data)
            # from the side of the hand, so that neither it nor the object hides the other
            camera.turn(float(np.degrees(np.arctan2(T[1, 3], T[0, 3]))) + 100.0)
            frames.append(camera.frame())
            name = f"{model.id}\n" if not labels else ""
            labels.append(name + ("no grasps" if grasp is None else f"Q1 {grasps.q1[grasp]:.3f}"))
    return strip(frames, labels)
