"""Both bounds of Q1 about the exact metric, and the gradient of the lower one."""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np
import pytest
import torch

from dmfc.config.losses import Q1Config, Q1LowerConfig
from dmfc.losses.q1 import lattice_directions, q1_of_contacts
from dmfc.losses.q1_lower import q1_lower_of_contacts
from tests.losses.test_loss_q1 import ROUND, contacts, exact_q1, wrenches
from tests.support.loss_shapes import slope

TIGHT = Q1LowerConfig(contacts=0, edges=8)
COARSE = Q1LowerConfig(contacts=6, edges=3)


def test_exact_metric_lies_between_the_bounds_and_all_grow_with_friction() -> None:
    problem = contacts(n=200, count=6, seed=5)
    before = np.zeros((3, 200))
    for friction in (0.4, 0.8):
        config = dataclasses.replace(ROUND, friction=friction)
        lower = q1_lower_of_contacts(*problem, config, COARSE).numpy()
        exact = [exact_q1(wrenches(*(x[i] for x in problem), config, 6)) for i in range(200)]
        upper = q1_of_contacts(*problem, config).numpy()
        now = np.stack([lower, exact, upper])
        assert (np.diff(now, axis=0) >= -1e-9).all()
        assert (now >= before - 1e-9).all()
        before = now
    assert (now.mean(axis=1) > 0.01).all()
    assert lower.sum() > 0.5 * now[1].sum()  # no idle bound


@pytest.mark.parametrize("torque_weight", [10.0, 0.01])
def test_with_all_edges_it_is_the_exact_metric(torque_weight: float) -> None:
    config = dataclasses.replace(ROUND, torque_weight=torque_weight)
    problem = contacts(n=10, count=10, seed=6)
    exact = [exact_q1(wrenches(*(x[i] for x in problem), config)) for i in range(10)]
    measured = q1_lower_of_contacts(*problem, config, TIGHT).numpy()
    assert measured == pytest.approx(np.array(exact), abs=1e-12)
    assert max(exact) > 0.01 * torque_weight


def test_more_contacts_and_edges_raise_it() -> None:
    problem = contacts(n=20, count=12, seed=7)
    bounds = [Q1LowerConfig(6, 3), Q1LowerConfig(12, 3), Q1LowerConfig(0, 6)]
    values = [q1_lower_of_contacts(*problem, ROUND, bound) for bound in bounds]
    for lower, higher in itertools.pairwise(values):
        assert (higher >= lower - 1e-12).all()
        assert (higher > lower).any()


def test_its_ball_is_inside_in_every_direction() -> None:
    problem = contacts(n=5, seed=8)
    lower = q1_lower_of_contacts(*problem, ROUND, Q1LowerConfig())
    for i in range(5):
        hull = wrenches(*(x[i] for x in problem), ROUND, edges=64)
        assert (hull @ lattice_directions(4032).numpy().T).max(axis=0).min() >= lower[i]


def test_without_force_closure() -> None:
    """Three contacts that all press down: 0, or minus the distance of their hull, by hand."""
    arms = torch.tensor([[[1.0, 0, 0], [-0.5, 0.75**0.5, 0], [-0.5, -(0.75**0.5), 0]]]).double()
    up = torch.tensor([0.0, 0, 1]).double().expand(1, 3, 3)
    config = Q1Config(friction=0.0, torque_weight=1.0, floor=False)
    distance = torch.full((1, 3), 0.01).double()
    bound = Q1LowerConfig()
    expected = -np.exp(-60 * 0.01)
    assert q1_lower_of_contacts(arms, up, distance, config, bound).item() == pytest.approx(expected)
    floored = dataclasses.replace(config, floor=True)
    assert q1_lower_of_contacts(arms, up, distance, floored, bound).item() == 0
    # Two opposite contacts hold against no turn about their line: their hull is flat.
    arms = torch.tensor([[[1.0, 0, 0], [-1.0, 0, 0]]]).double()
    flat = [q1_lower_of_contacts(arms, arms, distance[:, :2], c, bound) for c in (floored, config)]
    assert torch.cat(flat).abs().max() < 1e-9


@pytest.mark.parametrize("count", [5, 12])
@pytest.mark.parametrize("floor", [True, False])
def test_gradient(count: int, floor: bool) -> None:
    config = dataclasses.replace(ROUND, floor=floor)
    for seed in range(3):
        analytic, differences = slope(
            lambda *x: q1_lower_of_contacts(*x, config, Q1LowerConfig()),
            *contacts(count=count, seed=seed),
            seed=seed,
        )
        assert analytic == pytest.approx(differences, rel=1e-4)
        assert analytic != 0
