"""The checks of a label: does the hand hold the object, whichever way is down?

`check`: the object is held still while the fingers close on it, so that a label says where contact
is and not where a free object would have rolled. Then it is released, without gravity: most of what
fails is pushed out here, so it costs little. Then gravity is turned through the six axis
directions, in the same simulation. `lifts`: it also comes along from a table, where nothing holds
it.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import mujoco
import numpy as np

from dmfc.config.grasps import GraspsConfig
from dmfc.config.physics import PhysicsConfig
from dmfc.hand.description import HandDescription
from dmfc.hand.model import HandModel
from dmfc.objects.model import ObjectModel
from dmfc.physics.world import World, pose_to_qpos

_DIRECTIONS = np.concatenate([np.eye(3), -np.eye(3)])
_GRAVITY = 9.81
_INERTIA = 1e4
"""kg and kg m^2 of the object while the fingers close: 20 N move it by less than 0.1 mm."""
_LOOK = 10
"""Steps between two looks at the object."""
_FLOATING = np.array([[1.0, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 3], [0, 0, 0, 1]])
"""T_world_object of the floating object, above any table."""


@dataclass(frozen=True)
class Verdict:
    """What the simulation said of one candidate."""

    held: bool
    penetration: float
    """Deepest hand-object penetration once the fingers had closed, metres."""
    contacts: int
    """Links of the hand that touched the object then."""


def checking_world(
    description: HandDescription, model: ObjectModel, physics: PhysicsConfig, config: GraspsConfig
) -> World:
    """The hand and one object over a table, at the timestep of the checks."""
    physics = dataclasses.replace(physics, timestep=config.timestep)
    return World(description, [model], physics, table_size=2.0)


def check(
    world: World,
    hand: HandModel,
    T_object_palm: np.ndarray,
    joints: np.ndarray,
    config: GraspsConfig,
) -> Verdict:
    """Close to `joints` [D] and beyond, as execution does; release; turn gravity.

    `world` has the object, and perhaps a table, far below.
    """
    world.model.opt.gravity[:] = 0.0
    world.reset()
    world.place_object(0, _FLOATING)
    world.hold(0, _INERTIA)
    world.place_palm(_FLOATING @ T_object_palm, hand.opened(joints))
    _close(world, hand, joints, config)
    penetration, contacts = _touch(world)
    held = contacts >= 2 and penetration <= config.max_penetration
    if held:
        world.hold(0, 0.0)
        held = _hangs(world, config)
    return Verdict(held, penetration, contacts)


def seat(
    world: World,
    hand: HandModel,
    T_object_palm: np.ndarray,
    joints: np.ndarray,
    config: GraspsConfig,
) -> tuple[np.ndarray, np.ndarray] | None:
    """Close a fist from `joints` [D] around the object, which is free and moves as it is pushed.

    T_object_palm [4, 4] and joints [D] where they come to rest; None if no two links touch it.
    Wide and heavy objects, which fingers closed in place would push out, find their seat so.
    """
    world.model.opt.gravity[:] = 0.0
    world.reset()
    world.place_object(0, _FLOATING)
    world.place_palm(_FLOATING @ T_object_palm, joints)
    fist = np.clip(joints + config.seat_flexion * hand.flexion, hand.lower, hand.upper)
    world.drive_joints(fist)
    mujoco.mj_step(world.model, world.data, round(config.seat_time / world.model.opt.timestep))
    if world.diverged() or _touch(world)[1] < 2:
        return None
    return np.linalg.inv(world.object_pose(0)) @ world.palm_pose(), np.clip(
        world.joints(), hand.lower, hand.upper
    )


def lifts(
    world: World,
    hand: HandModel,
    T_world_object: np.ndarray,
    T_object_palm: np.ndarray,
    joints: np.ndarray,
    config: GraspsConfig,
) -> bool:
    """Whether the grasp lifts the object, free and at rest at T_world_object [4, 4], off the table.

    The hand begins open at the grasp pose. What it pushes away while it closes is not lifted.
    """
    model, data = world.model, world.data
    model.opt.gravity[:] = [0.0, 0.0, -_GRAVITY]
    world.reset()
    world.place_object(0, T_world_object)
    T_world_palm = T_world_object @ T_object_palm
    world.place_palm(T_world_palm, hand.opened(joints))
    _close(world, hand, joints, config)
    pose = pose_to_qpos(T_world_palm)
    steps = round(config.lift_time / model.opt.timestep)
    for step in range(steps):
        pose[2] = T_world_palm[2, 3] + config.lift_height * (step + 1) / steps
        world.drive_palm(pose)
        mujoco.mj_step(model, data)
    mujoco.mj_step(model, data, round(config.lift_hold / model.opt.timestep))
    centre = np.append(world.objects[0].com, 1.0)
    risen = ((world.object_pose(0) - T_world_object) @ centre)[2]
    owners, _ = world.contacts()
    on_table = bool((np.sort(owners, axis=1) == [-1, 0]).all(axis=1).any())
    held = risen > 0.5 * config.lift_height and _touch(world)[1] > 0
    return bool(held and not on_table and not world.diverged())


def _close(world: World, hand: HandModel, joints: np.ndarray, config: GraspsConfig) -> None:
    """Drive the fingers from open to squeezed in two thirds of the time, and wait."""
    opened, target = hand.opened(joints), hand.squeezed(joints)
    steps = round(config.close_time / world.model.opt.timestep)
    for step in range(steps):
        world.drive_joints(opened + min(1.0, 1.5 * (step + 1) / steps) * (target - opened))
        mujoco.mj_step(world.model, world.data)


def _hangs(world: World, config: GraspsConfig) -> bool:
    """Settle, then turn gravity; stops as soon as the object has slipped."""
    if not _stays(world, np.zeros(3), config.settle_time, config.max_slip, config.max_turn):
        return False
    for direction in _DIRECTIONS:
        gravity = _GRAVITY * direction
        slip, turn = config.max_gravity_slip, config.max_turn
        if not _stays(world, gravity, config.gravity_time, slip, turn):
            return False
    return _touch(world)[1] >= 2


def _stays(world: World, gravity: np.ndarray, seconds: float, slip: float, turn: float) -> bool:
    """Whether the object stays in the hand within `slip` metres and `turn` rad of where it is."""
    model, data = world.model, world.data
    model.opt.gravity[:] = gravity
    start = _T_palm_object(world)
    steps = round(seconds / model.opt.timestep)
    for first in range(0, steps, _LOOK):
        mujoco.mj_step(model, data, min(_LOOK, steps - first))
        if world.diverged():
            return False
        now = _T_palm_object(world)
        moved = (now - start)[:3] @ np.append(world.objects[0].com, 1.0)
        cosine = (np.trace(start[:3, :3].T @ now[:3, :3]) - 1) / 2
        if np.linalg.norm(moved) > slip or np.arccos(np.clip(cosine, -1, 1)) > turn:
            return False
    return True


def _T_palm_object(world: World) -> np.ndarray:
    return np.linalg.inv(world.palm_pose()) @ world.object_pose(0)


def _touch(world: World) -> tuple[float, int]:
    """Deepest hand-object penetration, metres, and the number of links that touch."""
    owners, gaps = world.contacts()
    touching = (owners.min(axis=1) == -2) & (owners.max(axis=1) == 0) if len(owners) else []
    if not np.any(touching):
        return 0.0, 0
    geoms = world.data.contact.geom[touching]
    hand_geoms = geoms[owners[touching] == -2]
    return float(-gaps[touching].min()), len(np.unique(world.model.geom_bodyid[hand_geoms]))
