"""Chamfer against brute force, confidence against its closed form."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from dmfc.config.losses import GraspSpace
from dmfc.losses.chamfer import chamfer, grasp_vector
from dmfc.losses.confidence import confidence_loss


def random(*shape: int, seed: int = 0) -> torch.Tensor:
    generator = torch.Generator().manual_seed(seed)
    return torch.randn(*shape, generator=generator, dtype=torch.float64)


def test_chamfer_is_the_masked_minimum() -> None:
    prediction, labels = random(3, 10, 27), random(3, 6, 27, seed=1)
    match = random(3, 10, 6, seed=2) > 0.8
    measured = chamfer(prediction, labels, match)
    for b in range(3):
        for i in range(10):
            found = [
                ((prediction[b, i] - labels[b, g]) ** 2).sum() for g in range(6) if match[b, i, g]
            ]
            assert measured[b, i].item() == pytest.approx(min(found).item() if found else 0.0)
    assert (~match.any(-1)).any()
    assert torch.equal(chamfer(prediction[0], labels[0], match[0]), measured[0])


def test_chamfer_gradient_and_unmatched_points() -> None:
    prediction, labels = random(8, 27).requires_grad_(), random(5, 27, seed=1)
    match = torch.ones(8, 5, dtype=torch.bool)
    match[3] = False
    assert torch.autograd.gradcheck(lambda p: chamfer(p, labels, match), prediction)
    (gradient,) = torch.autograd.grad(chamfer(prediction, labels, match).sum(), prediction)
    assert (gradient[3] == 0).all()


def test_chamfer_without_labels() -> None:
    assert (chamfer(random(4, 27), random(0, 27), torch.zeros(4, 0, dtype=torch.bool)) == 0).all()


def test_chamfer_keeps_its_digits_in_float32() -> None:
    labels = (random(50, 27) + 3).float()
    close = labels[:5] + 1e-4
    match = torch.ones(5, 50, dtype=torch.bool)
    assert chamfer(close, labels, match).numpy() == pytest.approx(27e-8, rel=1e-2)


def test_grasp_vector_weighs_joints_and_takes_positions_in_its_unit() -> None:
    space = GraspSpace(length_unit=0.1, joint_weight=0.25)
    first = grasp_vector(random(2, 3), random(2, 6), random(2, 18), space)
    second = grasp_vector(random(2, 3) + 0.3, random(2, 6), random(2, 18) + 2, space)
    assert first.shape == (2, 27)
    assert (first - second).square().sum(-1).numpy() == pytest.approx(3 * 3**2 + 0.25 * 18 * 4)


def test_confidence_closed_form() -> None:
    task, logit = torch.tensor([0.5, 2.0]), torch.tensor([0.0, 1.0])
    c = 1 / (1 + np.exp(-logit.numpy()))
    expected = (c * task.numpy() - 0.3 * np.log(c)).mean()
    assert confidence_loss(task, logit, 0.3).item() == pytest.approx(expected, rel=1e-6)


def test_best_confidence_is_weight_over_task() -> None:
    task = torch.tensor([2.0, 5.0, 20.0], dtype=torch.float64)
    best = 1 / task
    logit = torch.log(best / (1 - best)).requires_grad_()
    (gradient,) = torch.autograd.grad(confidence_loss(task, logit, 1.0), logit)
    assert gradient.abs().max() < 1e-12


def test_confidence_gradient_is_finite_where_it_saturates() -> None:
    logit = torch.tensor([-200.0, 200.0], dtype=torch.float64, requires_grad=True)
    task = torch.ones(2, dtype=torch.float64)
    loss = confidence_loss(task, logit, 1.0)
    assert loss.isfinite()
    assert torch.autograd.grad(loss, logit)[0].isfinite().all()
    inputs = (random(6).abs().requires_grad_(), random(6, seed=1).requires_grad_())
    assert torch.autograd.gradcheck(lambda t, z: confidence_loss(t, z, 0.5), inputs)
