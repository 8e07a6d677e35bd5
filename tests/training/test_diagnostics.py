"""Diagnostics of fine-tuning: of networks that were moved on purpose, and gradients by hand."""

from __future__ import annotations

import copy
import dataclasses

import pytest
import torch
from scipy.spatial.transform import Rotation

from dmfc.config.training import ProjectionConfig
from dmfc.geometry.rotations import rotation_vector
from dmfc.network.checkpoint import new_network
from dmfc.training.candidates import Candidates, label_vectors
from dmfc.training.diagnostics import Diagnostics
from tests.support.toy import NETWORK, toy_batch, toy_hand
from tests.training.test_projection import SWEPT
from tests.training.test_task import task


@pytest.fixture
def net():
    torch.manual_seed(0)
    return new_network(NETWORK, toy_hand())


def shifted(net, x: float, z: float):
    """The network with all of its hands moved, metres."""
    moved = copy.deepcopy(net)
    with torch.no_grad():
        moved.offset_head[-1].bias += torch.tensor([x, 0.0, z])
    return moved


def test_rotation_vectors_are_as_scipy_has_them():
    rotations = Rotation.random(50, random_state=0)
    measured = rotation_vector(torch.from_numpy(rotations.as_matrix())).numpy()
    assert measured == pytest.approx(rotations.as_rotvec(), abs=1e-6)
    assert rotation_vector(torch.eye(3)).tolist() == [0, 0, 0]


def test_hands_in_the_table_are_better_off_above_it(net):
    """With the swept term alone and all hands in the table, up is down its slope."""
    only = dataclasses.replace(
        SWEPT, weights=dataclasses.replace(SWEPT.weights, guidance=0.0, q1_upper=0.0)
    )
    low = shifted(net, 0.0, -0.25)
    found = Diagnostics(low, task(losses=only), toy_batch(), ProjectionConfig())
    assert low.training
    up = found.measure(shifted(low, 0.0, 0.01))
    down = found.measure(shifted(low, 0.0, -0.01))
    assert up["own_terms_fell"].mean() == 1
    assert down["own_terms_fell"].mean() == 0
    assert up["own_cosine_easy"].mean() > 0.3
    torch.testing.assert_close(up["own_cosine_easy"], -down["own_cosine_easy"], atol=1e-3, rtol=0)
    rows = toy_batch().match.any(-1).sum()
    assert len(up["own_terms_fell"]) == (found.total > 1e-3).sum() > 0.9 * rows
    assert len(up["own_cosine_easy"]) + len(up["own_cosine_hard"]) == rows
    assert len(up["own_cosine_easy"]) == pytest.approx(0.8 * float(rows), abs=1)
    assert len(found.measure(low)["own_cosine_easy"]) == 0  # nothing moved


def test_terms_at_the_labels_are_those_of_hands_placed_there(net):
    stage, batch = task(losses=SWEPT), toy_batch()
    found = Diagnostics(net, stage, batch, ProjectionConfig()).measure(net)
    rows = Candidates.of(net.eval()(batch.points, batch.seed_index), batch, stage.space)
    first = rows.take(rows.positive).take(torch.arange(1))
    vectors = label_vectors(batch, stage.space, net.centre)
    ours = torch.cat([first.aim / 0.05, first.rotation6d, 0.5 * first.joints], dim=1)
    allowed = batch.match[first.scene[0], rows.positive.nonzero()[0, 0]]
    nearest = (vectors[first.scene[0]] - ours).norm(dim=1).masked_fill(~allowed, torch.inf).argmin()
    at = dataclasses.replace(
        first,
        position=batch.grasp_position[0, nearest][None],
        rotation6d=batch.grasp_rotation[0, nearest, :, :2].mT.flatten()[None],
        joints=batch.grasp_joints[0, nearest][None],
    )
    for name, value in stage.cheap_terms(at, batch).items():
        torch.testing.assert_close(found[f"{name}_at_labels"][:1], value)
        assert len(found[f"{name}_at_labels"]) == rows.positive.sum()


def test_gradients_of_the_terms_add_up(net):
    """|a + b|^2 = |a|^2 + |b|^2 + 2 |a| |b| cos, the left side by one backward pass."""
    stage, batch = task(losses=SWEPT), toy_batch()
    diagnostics = Diagnostics(net, stage, batch, ProjectionConfig())
    found = diagnostics.measure(net)
    net.eval()
    rows = diagnostics._rows(net)
    few = rows.take(torch.arange(0, len(rows), max(1, len(rows) // 64)))
    terms = stage.cheap_terms(few, batch)
    (terms["guidance"].mean() + terms["swept"].mean()).backward()
    norm = torch.nn.utils.get_total_norm([p.grad for p in net.parameters() if p.grad is not None])
    a, b = found["gradient_norm_guidance"], found["gradient_norm_swept"]
    cosine = found["gradient_cosine_guidance_swept"]
    assert norm.item() ** 2 == pytest.approx((a**2 + b**2 + 2 * a * b * cosine).item(), rel=1e-3)
