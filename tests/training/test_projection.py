"""Projected targets: bounded, never worse, a prediction's own; what the network is drawn to."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from dmfc.config.losses import GraspSpace
from dmfc.config.training import ProjectionConfig, TrainingConfig
from dmfc.geometry.rotations import axis_angle_matrix, geodesic_angle
from dmfc.network.checkpoint import new_network
from dmfc.training.module import GraspTraining
from dmfc.training.projection import Moves, descent, project
from tests.support.toy import NETWORK, toy_hand
from tests.training.test_task import LOSSES, NO_FAILURE, prediction, task

BOUNDS = ProjectionConfig(steps=6)
SWEPT = dataclasses.replace(
    LOSSES,
    weights=dataclasses.replace(LOSSES.weights, collision=0.0, swept=1.0),
    saturated=True,
)


@pytest.fixture(scope="module")
def case():
    """A task with the swept term, the predictions of a fresh network, and where they went."""
    of = task(losses=SWEPT)
    predicted, batch = prediction()
    rows = of.candidates(predicted, batch)
    # Hands at many heights: some clear of everything, some deep in box and table.
    height = torch.linspace(-0.02, 0.2, len(rows))[:, None] * torch.tensor([0.0, 0, 1])
    rows = dataclasses.replace(rows, position=rows.position + height, aim=rows.aim + height)
    return of, rows, batch, project(rows, batch, of, BOUNDS)


def test_axis_angle_is_as_scipy_has_it():
    vector = np.random.default_rng(0).normal(size=(20, 3))
    expected = Rotation.from_rotvec(vector).as_matrix()
    measured = axis_angle_matrix(torch.from_numpy(vector)).numpy()
    assert measured == pytest.approx(expected, abs=1e-12)
    still = torch.zeros(1, 3, dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(axis_angle_matrix, still)


def test_no_step_makes_a_prediction_worse(case):
    of, _, _, found = case
    before, after = of.total(found.before), of.total(found.after)
    assert (after <= before).all()
    assert (after[found.moved] < before[found.moved]).all()
    assert torch.equal(after[~found.moved], before[~found.moved])
    assert found.moved.float().mean() > 0.2
    assert after.mean() < 0.95 * before.mean()
    for name, value in found.after.items():
        assert (value <= 1.1 * found.before[name] + 1e-3 + 1e-6).all()


def test_the_terms_at_the_target_are_those_that_are_told(case):
    of, rows, batch, found = case
    ours = torch.cat([rows.aim, rows.rotation6d, rows.joints], dim=1).detach()
    unit = torch.tensor([of.space.length_unit] * 3 + [1.0] * 6 + [of.space.joint_weight**-0.5] * 2)
    start = dataclasses.replace(
        rows, rotation6d=rows.rotation[..., :2].mT.flatten(1), joints=rows.joints.clamp(-0.3, 0.9)
    )
    start = torch.cat([start.aim, start.rotation6d, start.joints], dim=1).detach()
    target = start + unit * found.shift
    moved = dataclasses.replace(
        rows,
        aim=target[:, :3],
        position=target[:, :3],  # the toy network's aim is the palm's origin
        rotation6d=target[:, 3:9],
        joints=target[:, 9:],
    )
    assert ours.shape == start.shape
    for name, value in of.cheap_terms(moved, batch).items():
        torch.testing.assert_close(value, found.after[name], rtol=1e-3, atol=1e-4)


def test_motions_stay_within_their_bounds(case):
    of, rows, batch, _ = case
    tight = ProjectionConfig(steps=5, position=0.002, angle=0.02, joints=0.01)
    shift = project(rows, batch, of, tight).shift * torch.tensor(
        [of.space.length_unit] * 3 + [1.0] * 6 + [of.space.joint_weight**-0.5] * 2
    )
    assert shift[:, :3].norm(dim=1).max() <= 0.002 + 1e-6
    assert shift[:, 9:].abs().max() <= 0.01 + 1e-6
    x, y = rows.rotation[..., 0] + shift[:, 3:6], rows.rotation[..., 1] + shift[:, 6:9]
    turned = torch.stack([x, y, torch.linalg.cross(x, y)], dim=-1)
    assert geodesic_angle(rows.rotation, turned).max() <= 0.02 + 1e-4
    assert shift.abs().max() > 0.001


def test_what_one_prediction_does_is_nothing_to_another(case):
    of, rows, batch, found = case
    half = torch.arange(0, len(rows), 2)
    alone = project(rows.take(half), batch, of, BOUNDS)
    torch.testing.assert_close(alone.shift, found.shift[half], rtol=1e-4, atol=1e-5)


def test_the_slope_of_a_motion_by_differences(case):
    of, rows, batch, _ = case
    few = rows.take(torch.arange(0, len(rows), 16))
    few = dataclasses.replace(
        few,
        **{
            n: getattr(few, n).detach().double()
            for n in ("aim", "position", "rotation6d", "joints")
        },
    )
    doubled = dataclasses.replace(batch, T_world_object=batch.T_world_object.double())
    moves = Moves(few, of, BOUNDS)
    generator = torch.Generator().manual_seed(0)
    move, way = (0.3 * torch.randn(moves.still.shape, generator=generator).double() for _ in "ab")
    _, _, slope = descent(moves, move, of, doubled)
    ends = [descent(moves, move + s * 1e-6 * way, of, doubled)[1].sum() for s in (1, -1)]
    assert (slope * way).sum().item() == pytest.approx((ends[0] - ends[1]).item() / 2e-6, rel=1e-3)


def test_the_network_is_drawn_to_the_targets_and_not_along_the_terms():
    training = TrainingConfig(
        finetune_form="projected",
        hard_samples=0,
        projection=dataclasses.replace(BOUNDS, weight=3.0),
    )
    module = GraspTraining(
        new_network(NETWORK, toy_hand()), task(losses=SWEPT), training, NO_FAILURE
    )
    predicted, batch = prediction()
    rows = module.task.candidates(predicted, batch)
    error, terms = module._errors(rows, batch)
    found = project(rows, batch, module.task, training.projection)
    expected = module.task.total(terms).detach() + 3 * found.shift.square().sum(1)
    torch.testing.assert_close(error.detach(), expected)
    (slope,) = torch.autograd.grad((error - rows.chamfer).sum(), rows.joints, retain_graph=True)
    unit = GraspSpace().joint_weight ** 0.5
    torch.testing.assert_close(slope, -6 * unit * found.shift[:, 9:], rtol=1e-4, atol=1e-6)
