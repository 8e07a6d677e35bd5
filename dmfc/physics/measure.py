"""Measurements of a `World` after a step: touch, forces, speeds, torques.

Contacts and their forces are those of the step that was just taken.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import mujoco
import numpy as np

from dmfc.physics.world import World

HAND, TABLE_TOP = -2, -1
"""Owners of contacts that are no objects (see `Indices.geom_owner`)."""
FULL = 0.99
"""Share of its torque limit at which an actuator counts as saturated."""


@dataclass(frozen=True)
class Touch:
    """The contacts of the hand with one object."""

    position: np.ndarray
    """[c, 3] world frame, metres."""
    outward: np.ndarray
    """[c, 3] unit normals out of the object, world frame."""
    bodies: np.ndarray
    """[c] body of the hand that touches."""

    def __len__(self) -> int:
        return len(self.position)

    @property
    def links(self) -> int:
        """Links of the hand that touch."""
        return len(np.unique(self.bodies))


def touch(world: World, which: int) -> Touch:
    """Where the hand touches object `which`."""
    owners, _ = world.contacts()
    ours = (owners.min(axis=1) == HAND) & (owners.max(axis=1) == which)
    contact = world.data.contact
    # A contact's normal points from its first geom to its second.
    sign = np.where(owners[ours, 0] == which, 1.0, -1.0)
    geoms = contact.geom[ours][owners[ours] == HAND]
    return Touch(
        position=contact.pos[ours],
        outward=sign[:, None] * contact.frame[ours, :3],
        bodies=world.model.geom_bodyid[geoms],
    )


@dataclass(frozen=True)
class Depths:
    """Deepest penetrations of the hand, metres; 0 where it does not touch, and there alone."""

    table: float
    target: float
    others: float
    """Objects that are not the target."""
    itself: float
    """The hand's other links; those that MuJoCo lets collide."""


def depths(world: World, target: int) -> Depths:
    """How deep the hand is in everything around it."""
    owners, gaps = world.contacts()
    table = itself = inside = others = 0.0
    for (first, second), gap in zip(owners.tolist(), gaps.tolist(), strict=True):
        if HAND not in (first, second):
            continue
        other = max(first, second)
        if other == HAND:
            itself = max(itself, -gap)
        elif other == TABLE_TOP:
            table = max(table, -gap)
        elif other == target:
            inside = max(inside, -gap)
        else:
            others = max(others, -gap)
    return Depths(table, inside, others, itself)


def supported(world: World, which: int) -> bool:
    """Whether an object touches the table or another object."""
    owners, _ = world.contacts()
    ours = (owners == which).any(axis=1)
    return bool(((owners >= TABLE_TOP) & (owners != which))[ours].any())


def kinetic_speed(world: World, which: int) -> float:
    """Speed at which the object's kinetic energy would all be that of its translation, m/s.

    sqrt(2 E / m) with E = m |v|^2 / 2 + w^T I w / 2, v of the centre of mass.
    """
    model, index, data = world.objects[which], world.index, world.data
    first, pose = index.object_qvel[which], index.object_qpos[which]
    spin = data.qvel[first + 3 : first + 6]  # MuJoCo gives it in the body's frame
    lever = np.empty(3)
    mujoco.mju_cross(lever, spin, model.com)
    mujoco.mju_rotVecQuat(lever, lever.copy(), data.qpos[pose + 3 : pose + 7])
    centre = data.qvel[first : first + 3] + lever
    return math.sqrt(centre @ centre + spin @ model.inertia @ spin / model.mass)


def saturated(world: World) -> float:
    """Share of the hand's actuators that are at their torque limit, in [0, 1]."""
    low, high = world.torque_range
    force = world.data.actuator_force[world.index.actuator]
    return np.count_nonzero((force <= FULL * low) | (force >= FULL * high)) / len(force)
