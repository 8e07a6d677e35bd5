"""The naive sampler of grasps that the planner is measured against.

A palm near a random surface point, 0.5 to 5 cm from it, looking along its inward normal, turned at
random about it. Starts that touch are rejected. The open hand closes to one fixed flexed posture,
thumb opposed, around an object that floats at its real mass; then gravity is turned through the six
axis directions, 0.35 s each. A grasp holds if the object never leaves the hand.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import mujoco
import numpy as np

from dmfc.config.grasps import GraspsConfig
from dmfc.config.physics import PhysicsConfig
from dmfc.geometry.transforms import transform
from dmfc.grasps.check import check, checking_world, lifts
from dmfc.grasps.propose import Proposer
from dmfc.hand.description import HandDescription
from dmfc.hand.model import HandModel
from dmfc.objects.model import ObjectModel
from dmfc.physics.world import World

DIRECTIONS = np.concatenate([np.eye(3), -np.eye(3)])
FLEXION = 1.2  # rad of each knuckle in the flexed posture
CLOSE_TIME, GRAVITY_TIME = 0.35, 0.35  # s
LOST = 0.05  # metres from where the object was in the hand: it is not held any more


@dataclass(frozen=True)
class Sampled:
    """What a sampler found in its time."""

    seconds: float
    """CPU time of sampling and of its own simulation."""
    tried: int
    held: int
    """By its own criterion."""
    labels: int
    """Of these, what the planner would have stored: they pass its checks as well (not timed)."""


def sample(
    model: ObjectModel,
    hand: HandModel,
    description: HandDescription,
    physics: PhysicsConfig,
    config: GraspsConfig,
    seconds: float,
) -> Sampled:
    """Sample for so many seconds of CPU time."""
    generator = np.random.default_rng(config.seed)
    world = checking_world(description, model, physics, config)
    proposer = Proposer(model, hand, description, config)
    spent, tried, held, labels = 0.0, 0, 0, 0
    while spent < seconds:
        started = time.process_time()
        found = _try(world, hand, _palm(model, hand, generator))
        spent += time.process_time() - started
        tried += 1
        if found is not None:
            held += 1
            labels += _is_label(world, hand, proposer, *found, config)
    return Sampled(spent, tried, held, labels)


def _palm(model: ObjectModel, hand: HandModel, generator: np.random.Generator) -> np.ndarray:
    """T_object_palm [4, 4] of a start."""
    row = generator.integers(len(model.surface_points))
    inward = -model.surface_normals[row].astype(np.float64)
    side = np.cross(inward, generator.normal(size=3))
    side /= np.linalg.norm(side)
    own = hand.palm_normal
    across = np.cross(own, [1.0, 0.0, 0.0] if abs(own[0]) < 0.9 else [0.0, 1.0, 0.0])
    across /= np.linalg.norm(across)
    frame = np.stack([inward, side, np.cross(inward, side)], axis=1)
    rotation = frame @ np.stack([own, across, np.cross(own, across)], axis=1).T
    gap = generator.uniform(0.005, 0.05)
    at = model.surface_points[row] - gap * inward - rotation @ hand.palm_reference
    return transform(rotation, at)


def _try(
    world: World, hand: HandModel, T_object_palm: np.ndarray
) -> tuple[np.ndarray, np.ndarray] | None:
    """T_object_palm and joints of the closed hand, if it held."""
    model, data = world.model, world.data
    model.opt.gravity[:] = 0.0
    world.reset()
    floating = transform(np.eye(3), np.array([0.0, 0.0, 3.0]))
    world.place_object(0, floating)
    world.place_palm(floating @ T_object_palm, hand.open_joints)
    mujoco.mj_forward(model, data)
    if (world.contacts()[0].max(axis=1, initial=-2) >= 0).any():
        return None
    world.drive_joints(hand.open_joints + FLEXION * hand.flexion)
    if not _stays(world, CLOSE_TIME, None):
        return None
    closed = np.linalg.inv(world.object_pose(0)) @ world.palm_pose(), world.joints()
    for direction in DIRECTIONS:
        model.opt.gravity[:] = 9.81 * direction
        if not _stays(world, GRAVITY_TIME, closed[0]):
            return None
    return closed


def _stays(world: World, seconds: float, T_object_palm: np.ndarray | None) -> bool:
    """Whether the object stays in the hand and is touched; looked at every 20 steps."""
    for _ in range(round(seconds / world.model.opt.timestep / 20)):
        mujoco.mj_step(world.model, world.data, 20)
        if T_object_palm is not None:
            now = np.linalg.inv(world.object_pose(0)) @ world.palm_pose()
            if np.linalg.norm((now - T_object_palm)[:3, 3]) > LOST:
                return False
    return bool((world.contacts()[0].max(axis=1, initial=-2) >= 0).any())


def _is_label(
    world: World,
    hand: HandModel,
    proposer: Proposer,
    T_object_palm: np.ndarray,
    joints: np.ndarray,
    config: GraspsConfig,
) -> bool:
    """Whether the planner's own checks pass, in any stable pose of the object that it reaches."""
    if not check(world, hand, T_object_palm, joints, config).held:
        return False
    model = world.objects[0]
    count = len(model.stable_heights)
    reached = proposer.reachable(
        np.repeat(T_object_palm[None, :3, 3], count, axis=0),
        np.repeat(T_object_palm[None, :3, :3], count, axis=0),
        np.repeat(joints[None], count, axis=0),
        np.arange(count),
    )
    for pose in np.flatnonzero(reached):
        T = transform(
            model.stable_rotations[pose].astype(np.float64),
            np.array([0.0, 0.0, model.stable_heights[pose]]),
        )
        if lifts(world, hand, T, T_object_palm, joints, config):
            return True
    return False
