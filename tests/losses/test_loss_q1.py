"""The upper bound of Q1 against the exact metric and brute force."""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np
import pytest
import torch
from scipy.spatial import ConvexHull

from dmfc.config.losses import Q1Config
from dmfc.losses.q1 import _critical, cone_support, lattice_directions, q1_of_contacts, q1_upper
from dmfc.objects.atlas import SceneObjects
from tests.support.loss_shapes import slope

# Torques of 10 cm arms count as forces do: the hull is round enough for qhull.
ROUND = Q1Config(torque_weight=10.0, directions=728)


def contacts(n: int = 4, count: int = 12, seed: int = 0):
    """Random contacts on and near a ball: arms, outward normals, signed distances."""
    generator = torch.Generator().manual_seed(seed)
    arms = torch.randn(n, count, 3, generator=generator, dtype=torch.float64)
    arms = 0.05 * arms / arms.norm(dim=-1, keepdim=True)
    normals = arms / 0.05 + 0.3 * torch.randn(arms.shape, generator=generator, dtype=torch.float64)
    distance = -0.01 * torch.rand(n, count, generator=generator, dtype=torch.float64)
    return arms, torch.nn.functional.normalize(normals, dim=-1), distance


def wrenches(arms, normals, distance, config: Q1Config, edges: int = 8) -> np.ndarray:
    """Edges of one grasp's friction cones, weighted, in the metric M: [contacts * edges, 6]."""
    rows = []
    for p, n, d in zip(arms.numpy(), normals.numpy(), distance.numpy(), strict=True):
        first = np.cross(n, np.eye(3)[np.abs(n).argmin()])
        first /= np.linalg.norm(first)
        second = np.cross(n, first)
        for angle in 2 * np.pi * np.arange(edges) / edges:
            tangent = np.cos(angle) * first + np.sin(angle) * second
            force = -n + config.friction * tangent
            torque = config.torque_weight * np.cross(p, force)
            rows.append(np.exp(-config.alpha * abs(d)) * np.concatenate([force, torque]))
    return np.array(rows)


def exact_q1(points: np.ndarray) -> float:
    """Radius of the largest ball about the origin inside the hull of the wrenches and 0."""
    hull = ConvexHull(np.concatenate([points, np.zeros((1, 6))]))
    return max(float(-hull.equations[:, -1].max()), 0.0)


@pytest.mark.parametrize("count", [64, 728, 4032])
def test_upper_bound_is_above_the_exact_metric(count: int) -> None:
    config = dataclasses.replace(ROUND, directions=count)
    problem = contacts(n=12)
    upper = q1_of_contacts(*problem, config).numpy()
    exact = [exact_q1(wrenches(*(x[i] for x in problem), config)) for i in range(12)]
    assert (upper >= np.array(exact) - 1e-9).all()
    assert max(exact) > 0.05


def test_more_directions_come_close_to_the_exact_metric() -> None:
    """With all directions of a dense sample the bound meets the metric of finely cut cones."""
    problem = contacts(n=3, count=8, seed=2)
    for i in range(3):
        edges = wrenches(*(x[i] for x in problem), ROUND, edges=16)
        hull = ConvexHull(np.concatenate([edges, np.zeros((1, 6))]))
        normals = torch.tensor(hull.equations[hull.equations[:, -1].argmax(), :-1])[None]
        force, torque = normals[:, :3], 10.0 * normals[:, 3:]
        arms, out, distance = (x[i] for x in problem)
        along = force + torch.linalg.cross(torque.expand_as(arms), arms)
        perpendicular = -(along * out).sum(-1)
        support = cone_support(perpendicular, along.square().sum(-1), ROUND)
        bound = (support * torch.exp(-ROUND.alpha * distance.abs())).max().item()
        assert exact_q1(edges) <= bound + 1e-9
        assert bound == pytest.approx(exact_q1(edges), rel=0.1, abs=0.01)


@pytest.mark.parametrize("floor", [True, False])
def test_as_in_a_plain_loop(floor: bool) -> None:
    config = Q1Config(directions=64, floor=floor)
    arms, normals, distance = contacts(n=2, count=5, seed=4)
    expected, softened = [], []
    for i in range(2):
        best = []
        for s in lattice_directions(64).numpy():
            values = []
            for p, n, d in zip(
                arms[i].numpy(), normals[i].numpy(), distance[i].numpy(), strict=True
            ):
                G = np.block([[np.eye(3)], [np.cross(p, np.eye(3)).T]])
                assert np.allclose(
                    G @ [1, 2, 3], np.concatenate([[1, 2, 3], np.cross(p, [1, 2, 3])])
                )
                u = G.T @ np.diag([1, 1, 1, 1e-2, 1e-2, 1e-2]) @ s
                perp = u @ -n
                par = np.linalg.norm(u - perp * -n)
                value = perp + 0.7 * par
                values.append(np.exp(-60 * abs(d)) * (max(value, 0) if floor else value))
            best.append(max(values))
        expected.append(min(best))
        softened.append(np.sort(best)[:5].mean())
    measured = q1_of_contacts(arms, normals, distance, config).numpy()
    assert measured == pytest.approx(expected, abs=1e-9)
    five = dataclasses.replace(config, worst=5)
    measured = q1_of_contacts(arms, normals, distance, five).numpy()
    assert measured == pytest.approx(softened, abs=1e-9)


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_compiled_and_tensor_search_agree(monkeypatch: pytest.MonkeyPatch, dtype) -> None:
    config = Q1Config(directions=728, floor=False)  # no ties at 0
    given = [value.to(dtype) for value in contacts(n=8, count=45)]
    compiled = q1_of_contacts(*given, config)
    monkeypatch.setattr("dmfc.losses.q1._critical_compiled", _critical)
    torch.testing.assert_close(compiled, q1_of_contacts(*given, config))


def test_grows_with_friction() -> None:
    problem = contacts(n=20)
    values = [
        q1_of_contacts(*problem, dataclasses.replace(ROUND, friction=mu)) for mu in (0, 0.3, 0.7, 1)
    ]
    for lower, higher in itertools.pairwise(values):
        assert (higher >= lower).all()
    assert (values[-1] > values[0]).any()


def test_contacts_that_cannot_hold_have_zero() -> None:
    arms, normals, distance = contacts(n=1)
    above = torch.nn.functional.normalize(0.1 * normals + torch.tensor([0.0, 0, 1]), dim=-1)
    config = Q1Config(friction=0.1)
    assert q1_of_contacts(arms, above, distance, config).item() == 0
    free = dataclasses.replace(config, floor=False)
    assert q1_of_contacts(arms, above, distance, free).item() < 0


@pytest.mark.parametrize("count", [64, 728, 4032])
def test_directions(count: int) -> None:
    directions = lattice_directions(count)
    assert directions.shape == (count, 6)
    assert torch.allclose(directions.norm(dim=1), torch.ones(count, dtype=torch.float64))
    assert len(torch.unique((directions * 1e6).round(), dim=0)) == count
    assert directions.sum(0).abs().max() < 1e-9


def test_gradient_of_contacts() -> None:
    for seed in range(4):
        analytic, differences = slope(
            lambda *x: q1_of_contacts(*x, ROUND), *contacts(seed=seed), seed=seed
        )
        assert analytic == pytest.approx(differences, rel=1e-4)
        assert analytic != 0


def around(centre: torch.Tensor) -> torch.Tensor:
    generator = torch.Generator().manual_seed(0)
    spread = torch.randn(len(centre), 45, 3, generator=generator, dtype=torch.float64)
    return centre + 0.045 * spread / spread.norm(dim=-1, keepdim=True)


def test_a_grasp_is_judged_on_the_object_it_is_at(scene: SceneObjects) -> None:
    at_ball = around(scene.T_world_object[:, 0, None, :3, 3])
    q1 = q1_upper(at_ball, scene, Q1Config())
    alone = q1_upper(at_ball, scene.only(torch.tensor([0, 0])), Q1Config())
    assert torch.equal(q1, alone)
    # Contacts all over the ball, 5 mm off it: the weight of 5 mm times nearly 1/sqrt(2).
    assert (q1 > 0.4 * np.exp(-0.3)).all()
    at_box = around(scene.T_world_object[:, 1, None, :3, 3])[:1]
    first = scene.take(torch.tensor([0]))
    box = q1_upper(at_box, first.only(torch.tensor([1])), Q1Config())
    assert torch.equal(q1_upper(at_box, first, Q1Config()), box)


def test_gradient_through_the_surface(scene: SceneObjects) -> None:
    points = around(scene.T_world_object[:, 0, None, :3, 3])
    for seed in range(3):
        analytic, differences = slope(
            lambda x: torch.exp(-q1_upper(x, scene, ROUND)), points, seed=seed
        )
        assert analytic == pytest.approx(differences, rel=1e-4)
        assert analytic != 0
