"""The Shadow Hand and a few planned grasps, made once for the tests of grasps and of execution."""

from __future__ import annotations

import dataclasses
from functools import cache

import numpy as np

from dmfc.config.grasps import GraspsConfig
from dmfc.config.hand import HandConfig
from dmfc.config.losses import Q1Config
from dmfc.config.physics import PhysicsConfig
from dmfc.grasps.grasp_set import GraspSet
from dmfc.grasps.planner import plan
from dmfc.hand.build import build_hand
from dmfc.hand.description import HandDescription, load_description
from dmfc.hand.model import HandModel
from dmfc.objects.model import ObjectModel
from tests.support.physics_shapes import ball, block

CONFIG = GraspsConfig(per_object=6, max_checks=120, batch=128, keep=0.25, waypoints=3, repeats=0)
BLOCK_SIZE = np.array([0.05, 0.06, 0.12])
BALL_RADIUS = 0.033


@cache
def shadow() -> tuple[HandModel, HandDescription]:
    """Needs the hand's pack: tests ask for the fixture `shadow_hand_dir` first."""
    return build_hand(HandConfig()), load_description("shadow")


@cache
def shape(name: str) -> ObjectModel:
    """'block' or 'ball', both of a mass that a hand holds easily."""
    return {"block": block(size=tuple(BLOCK_SIZE)), "ball": ball(radius=BALL_RADIUS)}[name]


@cache
def planned(name: str) -> GraspSet:
    hand, description = shadow()
    return plan(shape(name), hand, description, CONFIG, PhysicsConfig(), Q1Config())


def heavy(model: ObjectModel, mass: float = 50.0) -> ObjectModel:
    """The same shape, but `mass` kg."""
    return dataclasses.replace(model, mass=mass, inertia=model.inertia * mass / model.mass)


FRICTIONLESS = PhysicsConfig(
    hand_friction=0.0, object_friction=0.0, torsional_friction=0.0, rolling_friction=0.0
)


def depth_in_block(points: np.ndarray) -> np.ndarray:
    """Signed distance [...] to the block at points [..., 3], positive inside: closed form."""
    beyond = np.abs(points) - BLOCK_SIZE / 2
    outside = np.linalg.norm(np.maximum(beyond, 0.0), axis=-1)
    return -(outside + np.minimum(beyond.max(axis=-1), 0.0))
