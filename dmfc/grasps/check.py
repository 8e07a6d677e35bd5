"""The checks of a label: does the hand hold the object, whichever way is down?

`check`: the object is pinned while the fingers close on it, so that a label says where contact is
and not where a free object would have rolled. Then it is released, and gravity is turned through
the six axis directions, in one simulation. `lifts`: it also comes along from a table, where nothing
pins it.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from dmfc.config.grasps import GraspsConfig
from dmfc.hand.model import HandModel
from dmfc.physics.world import World, pose_to_qpos

_DIRECTIONS = np.concatenate([np.eye(3), -np.eye(3)])
_GRAVITY = 9.81
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


def check(
    world: World,
    hand: HandModel,
    T_object_palm: np.ndarray,
    joints: np.ndarray,
    config: GraspsConfig,
) -> Verdict:
    """Close to `joints` [D] and beyond, as execution does; release; turn gravity.

    `world` has the object, which it can hold, and perhaps a table, far below.
    """
    world.model.opt.gravity[:] = 0.0
    world.reset()
    world.place_object(0, _FLOATING)
    world.hold(0, True)
    world.place_palm(_FLOATING @ T_object_palm, hand.opened(joints))
    _close(world, hand, joints, config)
    penetration, contacts = _touch(world)
    held = contacts >= 2 and penetration <= config.max_penetration
    if held:
        world.hold(0, False)
        held = _hangs(world, config)
    return Verdict(held, penetration, contacts)


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
    model, data, timestep = world.model, world.data, world.model.opt.timestep
    start = np.linalg.inv(world.palm_pose()) @ world.object_pose(0)
    phases = [(np.zeros(3), config.settle_time)]
    phases += [(_GRAVITY * direction, config.gravity_time) for direction in _DIRECTIONS]
    look = 25
    for gravity, seconds in phases:
        model.opt.gravity[:] = gravity
        for first in range(0, round(seconds / timestep), look):
            mujoco.mj_step(model, data, min(look, round(seconds / timestep) - first))
            if world.diverged() or _slipped(world, start, config):
                return False
    return _touch(world)[1] >= 2


def _slipped(world: World, start: np.ndarray, config: GraspsConfig) -> bool:
    now = np.linalg.inv(world.palm_pose()) @ world.object_pose(0)
    centre = np.append(world.objects[0].com, 1.0)
    turn = np.arccos(np.clip((np.trace(start[:3, :3].T @ now[:3, :3]) - 1) / 2, -1, 1))
    slip = np.linalg.norm((now - start)[:3] @ centre)
    return bool(slip > config.max_slip or turn > config.max_turn)


def _touch(world: World) -> tuple[float, int]:
    """Deepest hand-object penetration, metres, and the number of links that touch."""
    owners, gaps = world.contacts()
    touching = (owners.min(axis=1) == -2) & (owners.max(axis=1) == 0) if len(owners) else []
    if not np.any(touching):
        return 0.0, 0
    geoms = world.data.contact.geom[touching]
    hand_geoms = geoms[owners[touching] == -2]
    return float(-gaps[touching].min()), len(np.unique(world.model.geom_bodyid[hand_geoms]))
