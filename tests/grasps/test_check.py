"""The checks of labels, by what must hold and what cannot."""

from __future__ import annotations

import dataclasses

import mujoco
import numpy as np
import pytest

from dmfc.config.physics import PhysicsConfig
from dmfc.grasps.check import check, checking_world, lifts, seat
from dmfc.hand.description import HandDescription
from dmfc.hand.model import HandModel
from dmfc.physics.world import World
from tests.support.grasp_shapes import CONFIG, FRICTIONLESS, heavy, planned, shape
from tests.support.physics_shapes import pose


def world_of(
    description: HandDescription, name: str, physics: PhysicsConfig, mass: float = 0.0
) -> World:
    model = heavy(shape(name), mass) if mass else shape(name)
    return checking_world(description, model, physics, CONFIG)


def standing(name: str) -> np.ndarray:
    return pose(z=float(shape(name).stable_heights[0]))


@pytest.mark.parametrize("name", ["block", "ball"])
def test_planned_grasps_hold_and_lift(
    hand: HandModel, description: HandDescription, name: str
) -> None:
    world, grasps = world_of(description, name, PhysicsConfig()), planned(name)[:2]
    for T, joints, depth in zip(
        grasps.T_object_palm, grasps.joints, grasps.penetration, strict=True
    ):
        verdict = check(world, hand, T, joints, CONFIG)
        assert verdict.held
        assert verdict.contacts >= 2
        assert verdict.penetration == pytest.approx(depth, abs=1e-6)
        assert 0 < verdict.penetration <= CONFIG.max_penetration
        assert lifts(world, hand, standing(name), T, joints, CONFIG)


def test_a_check_does_not_remember_the_one_before(
    hand: HandModel, description: HandDescription
) -> None:
    grasps = planned("block")
    T, joints = grasps.T_object_palm, grasps.joints
    fresh = check(world_of(description, "block", PhysicsConfig()), hand, T[1], joints[1], CONFIG)
    used = world_of(description, "block", PhysicsConfig())
    lifts(used, hand, standing("block"), T[0], joints[0], CONFIG)
    check(used, hand, T[0] @ pose(x=0.01), joints[0], CONFIG)
    assert check(used, hand, T[1], joints[1], CONFIG) == fresh


def test_a_hand_that_is_elsewhere_holds_nothing(
    hand: HandModel, description: HandDescription
) -> None:
    world, grasps = world_of(description, "block", PhysicsConfig()), planned("block")
    for T, joints in zip(grasps.T_object_palm[:3], grasps.joints[:3], strict=True):
        away = pose(x=0.5) @ T
        verdict = check(world, hand, away, joints, CONFIG)
        assert (verdict.held, verdict.contacts, verdict.penetration) == (False, 0, 0.0)
        assert not lifts(world, hand, standing("block"), pose(x=0.5) @ T, joints, CONFIG)


@pytest.mark.parametrize(
    ("physics", "mass"),
    [(FRICTIONLESS, 0.0), (PhysicsConfig(), 50.0), (PhysicsConfig(gain_scale=1e-6), 0.0)],
    ids=["no friction", "50 kg", "no force"],
)
def test_what_cannot_be_held_is_not(
    hand: HandModel, description: HandDescription, physics: PhysicsConfig, mass: float
) -> None:
    world, grasps = world_of(description, "block", physics, mass), planned("block")
    for T, joints in zip(grasps.T_object_palm, grasps.joints, strict=True):
        assert not check(world, hand, T, joints, CONFIG).held
        assert not lifts(world, hand, standing("block"), T, joints, CONFIG)


def test_a_label_that_presses_too_deep_is_dropped(
    hand: HandModel, description: HandDescription
) -> None:
    world, grasps = world_of(description, "block", PhysicsConfig()), planned("block")
    T, joints = grasps.T_object_palm[0], grasps.joints[0]
    strict = dataclasses.replace(CONFIG, max_penetration=1e-5)
    loose = check(world, hand, T, joints, CONFIG)
    assert loose.held
    assert check(world, hand, T, joints, strict) == dataclasses.replace(loose, held=False)


def test_a_fist_pulls_a_free_object_to_its_seat(
    hand: HandModel, description: HandDescription
) -> None:
    """Off the middle by a centimetre, at rest it touches, and the hand is where it was told."""
    world, grasps = world_of(description, "ball", PhysicsConfig()), planned("ball")
    start = pose(y=0.01) @ grasps.T_object_palm[0]
    seated = seat(world, hand, start, hand.open_joints, CONFIG)
    assert seated is not None
    T, joints = seated
    assert np.linalg.norm((T - start)[:3, 3]) > 0.001
    assert ((hand.lower <= joints) & (joints <= hand.upper)).all()
    world.reset()
    world.place_object(0, pose(z=3.0))
    world.place_palm(pose(z=3.0) @ T, joints)
    mujoco.mj_forward(world.model, world.data)
    owners, _ = world.contacts()
    assert (owners.max(axis=1) == 0).sum() >= 2


def test_a_fist_beside_the_object_seats_nothing(
    hand: HandModel, description: HandDescription
) -> None:
    world, grasps = world_of(description, "ball", PhysicsConfig()), planned("ball")
    away = pose(x=0.5) @ grasps.T_object_palm[0]
    assert seat(world, hand, away, hand.open_joints, CONFIG) is None
