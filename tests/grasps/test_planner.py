"""The planner's sets, and the palm's projection on the surface against closed forms."""

from __future__ import annotations

import dataclasses
from itertools import pairwise

import numpy as np
import pytest
import torch

from dmfc.config.losses import Q1Config
from dmfc.config.physics import PhysicsConfig
from dmfc.grasps.grasp_set import GraspSet
from dmfc.grasps.palm_hits import palm_hits
from dmfc.grasps.planner import plan
from dmfc.hand.description import HandDescription
from dmfc.hand.kinematics import HandKinematics
from dmfc.hand.model import HandModel
from tests.support.grasp_shapes import (
    BALL_RADIUS,
    BLOCK_SIZE,
    CONFIG,
    depth_in_block,
    heavy,
    planned,
    shape,
)

SMALL = dataclasses.replace(CONFIG, per_object=2, batch=48, max_checks=20, close_steps=12)


def plan_block(hand: HandModel, description: HandDescription, mass: float = 0.0, **changes: object):
    model = heavy(shape("block"), mass) if mass else shape("block")
    config = dataclasses.replace(SMALL, **changes)
    return plan(model, hand, description, config, PhysicsConfig(), Q1Config())


@pytest.mark.parametrize("name", ["block", "ball"])
def test_small_objects_get_grasps(hand: HandModel, name: str) -> None:
    grasps = planned(name)
    assert len(grasps) == CONFIG.per_object
    assert grasps.object_id == shape(name).id
    assert grasps.hand == hand.name
    assert grasps.dof_names == hand.dof_names
    assert (grasps.q1 > 0).all()
    assert (grasps.robustness == 1.0).all()
    assert (grasps.contacts >= 2).all()
    assert (grasps.penetration <= CONFIG.max_penetration).all()
    assert (grasps.joints >= hand.lower).all()
    assert (grasps.joints <= hand.upper).all()
    checked, held = int(grasps.notes["checked"]), int(grasps.notes["held"])
    assert CONFIG.per_object <= held <= checked <= CONFIG.max_checks


def test_labels_say_where_contact_is(hand: HandModel) -> None:
    grasps = planned("block")
    T = torch.as_tensor(grasps.T_object_palm)
    points = HandKinematics(hand).collision_points(T, torch.as_tensor(grasps.joints)).numpy()
    deepest = depth_in_block(points).max(axis=1)
    assert np.abs(deepest).max() < 0.004


def test_no_two_grasps_are_nearly_the_same() -> None:
    for grasps in (planned("block"), planned("ball")):
        turned = 0.05 * grasps.rotation[:, :, :2].reshape(len(grasps), -1)
        pose = np.concatenate([grasps.position, turned], axis=1)
        apart = np.linalg.norm(pose[:, None] - pose[None], axis=2)
        assert apart[~np.eye(len(pose), dtype=bool)].min() >= CONFIG.min_distance


def test_nothing_is_kept_that_is_too_near_another(
    hand: HandModel, description: HandDescription
) -> None:
    assert len(plan_block(hand, description, min_distance=10.0, max_batches=4)) == 1


def test_the_same_seed_plans_the_same_set(hand: HandModel, description: HandDescription) -> None:
    first, second = (plan_block(hand, description) for _ in range(2))
    assert first.notes == second.notes
    for entry in dataclasses.fields(GraspSet):
        one, two = getattr(first, entry.name), getattr(second, entry.name)
        assert (
            np.array_equal(one, two, equal_nan=True)
            if isinstance(one, np.ndarray)
            else (one == two)
        )
    other = plan_block(hand, description, seed=1)
    assert not np.array_equal(other.position, first.position)


def test_robustness_is_the_share_of_repeats_that_held(
    hand: HandModel, description: HandDescription
) -> None:
    sure = plan_block(hand, description, per_object=1, repeats=2, repeat_shift=0.0, repeat_turn=0.0)
    assert sure.robustness.tolist() == [1.0]
    wild = plan_block(hand, description, per_object=1, repeats=2, repeat_shift=3.0)
    assert wild.robustness == pytest.approx(1 / 3)


def test_what_cannot_be_held_has_an_empty_set(
    hand: HandModel, description: HandDescription
) -> None:
    grasps = plan_block(hand, description, mass=50.0, max_checks=4)
    assert len(grasps) == 0
    assert (grasps.notes["checked"], grasps.notes["held"]) == ("4", "0")
    nowhere = plan_block(
        hand,
        description,
        palm_gap=[-0.03, -0.03],
        palm_shift=[0.0, 0.0],
        back_off=0.0,
        batch=8,
        seat_gap=[0.3, 0.3],
    )
    assert len(nowhere) == 0
    assert nowhere.notes["checked"] == "0"


def test_each_way_gives_grasps(hand: HandModel, description: HandDescription) -> None:
    """Of the block some by fingers closed in place, some by a fist; the checks are the same."""
    grasps = plan_block(hand, description, per_object=20, max_checks=400, max_batches=20)
    assert 0 < int(grasps.notes["seated"]) < int(grasps.notes["held"])


def test_progress_goes_from_nothing_to_all(hand: HandModel, description: HandDescription) -> None:
    told: list[tuple[float, str]] = []
    plan(
        shape("block"),
        hand,
        description,
        SMALL,
        PhysicsConfig(),
        Q1Config(),
        lambda fraction, message: told.append((fraction, message)),
    )
    fractions = [fraction for fraction, _ in told]
    assert all(before <= after for before, after in pairwise(fractions))
    assert 0 < fractions[0] <= fractions[-1] == 1.0


# ── the palm's projection ────────────────────────────────────────────────────────────────────────

REACH = 0.02


def unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def test_palm_hits_on_a_ball() -> None:
    """|p + t d| = r: t = -p.d - sqrt((p.d)^2 - p.p + r^2); the ball's facets lie 0.2 mm below."""
    generator = np.random.default_rng(0)
    start = 0.12 * unit(generator.normal(size=(200, 3)))
    aim = BALL_RADIUS * generator.uniform(0, 0.9, (200, 1)) * unit(generator.normal(size=(200, 3)))
    direction = unit(aim - start)
    along = np.einsum("ni,ni->n", start, direction)
    t = -along - np.sqrt(along**2 - (start**2).sum(1) + BALL_RADIUS**2)
    hits = palm_hits(shape("ball"), start, direction, REACH)
    assert np.isfinite(hits).all()
    assert np.linalg.norm(hits - (start + t[:, None] * direction), axis=1).max() < 0.0015


def test_palm_hits_on_a_block() -> None:
    """Rays along an axis meet the face that looks at them."""
    generator = np.random.default_rng(1)
    for axis in range(3):
        for sign in (-1.0, 1.0):
            start = generator.uniform(-0.4, 0.4, (20, 3)) * BLOCK_SIZE
            expected = start.copy()
            expected[:, axis] = sign * BLOCK_SIZE[axis] / 2
            start[:, axis] = sign * 0.2
            direction = np.zeros((20, 3))
            direction[:, axis] = -sign
            hits = palm_hits(shape("block"), start, direction, REACH)
            assert hits == pytest.approx(expected, abs=0.001)


def test_palm_hits_of_rays_that_pass_by() -> None:
    near, far = BALL_RADIUS + 0.5 * REACH, BALL_RADIUS + 1.5 * REACH
    start = np.array([[near, 0, 0.2], [far, 0, 0.2], [0, 0, 0.2]])
    direction = np.array([[0, 0, -1.0], [0, 0, -1.0], [0, 0, 1.0]])
    hits = palm_hits(shape("ball"), start, direction, REACH)
    # A sample of the surface every 3 mm, the nearest to where the ray passes.
    assert hits[0] == pytest.approx([BALL_RADIUS, 0, 0], abs=0.004)
    assert np.isnan(hits[1:]).all()


def test_planned_palms_project_onto_the_surface() -> None:
    hits = planned("block").palm_hit
    assert np.isfinite(hits).all(axis=1).mean() > 0.5
    assert np.abs(depth_in_block(hits[np.isfinite(hits).all(axis=1)])).max() < 0.001
