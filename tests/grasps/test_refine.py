"""Refinement by gradients: against differences, closed-form distances and the joints' limits."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import torch

from dmfc.config.grasps import RefineConfig
from dmfc.config.losses import Q1Config
from dmfc.config.physics import PhysicsConfig
from dmfc.geometry.rotations import matrix_from_6d, sixd_from_matrix
from dmfc.grasps.planner import plan
from dmfc.grasps.propose import Candidates
from dmfc.grasps.refine import Objective, Refiner, refine
from dmfc.hand.description import HandDescription
from dmfc.hand.kinematics import HandKinematics
from dmfc.hand.model import HandModel
from dmfc.objects.atlas import ObjectAtlas, SceneObjects
from tests.support.grasp_shapes import BALL_RADIUS, CONFIG, depth_in_block, planned, shape
from tests.support.loss_shapes import slope

STEPS = RefineConfig(steps=15, step=0.02, points=0)
DEPTH = {"block": depth_in_block, "ball": lambda p: BALL_RADIUS - np.linalg.norm(p, axis=-1)}


def sunk(hand: HandModel, name: str, pose: int = -1) -> Candidates:
    """Planned grasps, their palms 15 mm too deep and their joints a little off, on purpose."""
    grasps = planned(name)
    generator = np.random.default_rng(0)
    position = grasps.position + 0.015 * grasps.rotation @ hand.palm_normal
    joints = grasps.joints + generator.normal(0.0, 0.1, grasps.joints.shape)
    joints = np.clip(joints, hand.lower, hand.upper)
    touching = np.zeros((len(grasps), 5), dtype=bool)
    poses = np.full(len(grasps), pose)
    return Candidates(position, grasps.rotation, joints, joints, touching, poses)


def points_of(hand: HandModel, found: Candidates) -> np.ndarray:
    T, joints = torch.as_tensor(found.T_object_palm), torch.as_tensor(found.joints)
    return HandKinematics(hand).collision_points(T, joints).numpy()


def beside(name: str, found: Candidates) -> tuple[torch.Tensor, ...]:
    """Palms and joints in float64, and the object with its frame 3 m above the table."""
    T = torch.eye(4, dtype=torch.float64)
    T[2, 3] = 3.0
    palm = T @ torch.as_tensor(found.T_object_palm)
    index = torch.zeros(len(found), 1, dtype=torch.int64)
    objects = SceneObjects(ObjectAtlas.of([shape(name)]), index, T.expand(len(found), 1, 4, 4))
    return palm[:, :3, 3], palm[:, :3, :3], torch.as_tensor(found.joints), objects


@pytest.mark.parametrize("name", ["block", "ball"])
def test_it_comes_out_of_the_object(hand: HandModel, name: str) -> None:
    """The penetration, by the closed form of the shape, is halved at least."""
    start = sunk(hand, name)
    found = Refiner(shape(name), hand, dataclasses.replace(CONFIG, refine=STEPS), Q1Config())(start)
    before, after = (
        np.maximum(DEPTH[name](points_of(hand, c)), 0).max(axis=1) for c in (start, found)
    )
    assert before.min() > 0.003
    assert (after < before).all()
    assert after.mean() < 0.5 * before.mean()


def test_it_comes_out_of_the_table(hand: HandModel) -> None:
    """Heights above the table, from the stable pose alone: below it there is less of the hand."""
    start, model = sunk(hand, "block", pose=0), shape("block")
    start = dataclasses.replace(start, position=start.position - [0, 0, 0.05])
    settings = dataclasses.replace(STEPS, guidance_weight=0.0, q1_weight=0.0)
    config = dataclasses.replace(CONFIG, refine=settings)
    found = Refiner(model, hand, config, Q1Config())(start)
    up, height = model.stable_rotations[0, 2], model.stable_heights[0]
    below = [np.maximum(-(points_of(hand, c) @ up + height), 0).max(axis=1) for c in (start, found)]
    assert below[0].max() > 0.005
    assert below[1].max() < 0.7 * below[0].max()


def test_the_objective_falls_and_joints_keep_their_limits(hand: HandModel) -> None:
    objective = Objective(hand, STEPS, Q1Config())
    position, rotation, joints, objects = beside("block", sunk(hand, "block"))
    wild = joints + 2.0 * torch.randn(joints.shape, generator=torch.Generator().manual_seed(0))
    found = refine(objective, position, rotation, wild.double(), objects, STEPS)
    assert (found.after <= found.before).all()
    assert (found.after < 0.8 * found.before).float().mean() > 0.8
    assert (found.joints >= objective.lower).all()
    assert (found.joints <= objective.upper).all()
    assert torch.equal(
        found.after, objective(found.position, found.rotation, found.joints, objects)
    )
    eye = found.rotation @ found.rotation.mT
    assert torch.allclose(eye, torch.eye(3).double().expand_as(eye), atol=1e-12)


def test_gradients_are_those_of_differences(hand: HandModel) -> None:
    objective = Objective(hand, STEPS, Q1Config())
    position, rotation, joints, objects = beside("ball", sunk(hand, "ball"))
    inside = joints.clamp(objective.lower + 0.01, objective.upper - 0.01)

    def value(place: torch.Tensor, turn: torch.Tensor, bend: torch.Tensor) -> torch.Tensor:
        return objective(place, matrix_from_6d(turn[:, :3], turn[:, 3:]), bend, objects)

    analytic, numeric = slope(value, position, sixd_from_matrix(rotation), inside)
    assert analytic == pytest.approx(numeric, rel=1e-3)
    assert abs(analytic) > 1e-3


def test_hands_do_not_affect_one_another(hand: HandModel) -> None:
    objective = Objective(hand, STEPS, Q1Config())
    position, rotation, joints, objects = beside("block", sunk(hand, "block"))
    both = refine(objective, position, rotation, joints, objects, STEPS)
    one = torch.tensor([2])
    alone = refine(objective, position[one], rotation[one], joints[one], objects.take(one), STEPS)
    assert torch.allclose(alone.joints, both.joints[one], atol=1e-9)
    assert torch.allclose(alone.position, both.position[one], atol=1e-9)


@pytest.mark.parametrize("which", ["kept", "batch"])
def test_planned_sets_of_refined_candidates_hold_too(
    hand: HandModel, description: HandDescription, which: str
) -> None:
    settings = RefineConfig(steps=3, which=which)  # type: ignore[arg-type]
    config = dataclasses.replace(CONFIG, per_object=3, refine=settings)
    grasps = plan(shape("block"), hand, description, config, PhysicsConfig(), Q1Config())
    assert len(grasps) == 3
    assert (grasps.penetration <= config.max_penetration).all()
    assert (grasps.joints >= hand.lower).all()
    assert (grasps.joints <= hand.upper).all()
    found = planned("block")
    assert not np.array_equal(grasps.position, found.position[: len(grasps)])


@pytest.mark.parametrize(
    "settings",
    [{"steps": -1}, {"step": 0.0}, {"steps": 1, "collision_weight": 0, "guidance_weight": 0}],
)
def test_what_cannot_be_descended_is_refused(settings: dict[str, float]) -> None:
    with pytest.raises(ValueError, match=r"grasps\.refine"):
        RefineConfig(**({"q1_weight": 0.0} | settings))  # type: ignore[arg-type]
