"""Collision and guidance against closed forms and brute force."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from dmfc.geometry.transforms import apply, inverse
from dmfc.hand.kinematics import HandKinematics
from dmfc.hand.model import HandModel
from dmfc.losses.collision import SelfCollision, collision, object_penetration, table_penetration
from dmfc.losses.guidance import guidance, tips
from dmfc.objects.atlas import SceneObjects
from tests.support.loss_shapes import BALL, ball_distance, box_distance, slope


def around(centre: torch.Tensor, spread: float, count: int = 200, seed: int = 0) -> torch.Tensor:
    generator = torch.Generator().manual_seed(seed)
    return centre + spread * torch.randn(
        *centre.shape[:-2], count, 3, generator=generator, dtype=torch.float64
    )


def test_zero_apart(scene: SceneObjects) -> None:
    p = around(torch.tensor([[[-0.3, 0, 0.3]]] * 2), 0.03)
    p[..., 2].clamp_(min=0)
    assert (collision(p, scene) == 0).all()


def test_table() -> None:
    p = torch.tensor([[[0, 0, -0.01], [0, 0, 0.02], [1, 1, -0.03]]])
    assert table_penetration(p).item() == pytest.approx(1e-4 + 9e-4)


def test_ball_and_box_as_in_closed_form(scene: SceneObjects) -> None:
    ball = scene.T_world_object[:, 0, None, :3, 3]
    p = around(ball, 0.03)
    p[0, 100:] += scene.T_world_object[0, 1, :3, 3] - ball[0]  # half of them are about the box
    depth = (BALL - (p - ball).norm(dim=-1)).clamp(min=0)
    expected = depth.square().sum(-1).numpy()
    T = inverse(scene.T_world_object[0, 1])
    box = np.maximum(box_distance(apply(T, p[0]).numpy()), 0)
    assert (box > 0).sum() > 20
    expected[0] += (box**2).sum()
    measured = object_penetration(p, scene)
    assert measured.numpy() == pytest.approx(expected, rel=5e-3)
    assert (measured > 0).all()
    # Nothing below the table: divided by points times (table + objects).
    assert torch.allclose(collision(p, scene), measured / (200 * torch.tensor([3.0, 2.0])))


@pytest.mark.parametrize(("row", "closed_form"), [(0, ball_distance), (1, box_distance)])
def test_each_point_counts_inside_alone(scene: SceneObjects, row: int, closed_form) -> None:
    """One point per grasp: d^2 of the closed form inside a ball or a box, and 0 outside."""
    shape = scene.take(torch.tensor([0])).only(torch.tensor([row]))
    p = around(shape.T_world_object[:, 0, None, :3, 3], 0.025)[0]
    depth = closed_form(apply(inverse(shape.T_world_object[0, 0]), p).numpy())
    measured = object_penetration(p[:, None], shape.take(torch.zeros(200, dtype=torch.int64)))
    surface = np.abs(depth) < 6e-4  # trilinear values of a 1 mm grid
    assert ((measured.numpy() > 0) == (depth > 0))[~surface].all()
    assert measured.sqrt().numpy() == pytest.approx(np.maximum(depth, 0), abs=6e-4)
    assert 40 < (depth > 0).sum() < 180


def test_collision_gradient(scene: SceneObjects) -> None:
    p = around(torch.tensor([[[0.05, 0, 0.03]]] * 2), 0.05)
    analytic, differences = slope(lambda x: collision(x, scene), p)
    assert analytic == pytest.approx(differences, rel=1e-4)
    assert analytic != 0


def test_guidance_of_a_ball_alone(scene: SceneObjects) -> None:
    alone = scene.take(torch.tensor([1]))
    centre = alone.T_world_object[:, 0, None, :3, 3]
    p = centre + 0.05 * torch.nn.functional.normalize(around(0 * centre, 1.0, 45), dim=-1)
    p[:, 20:] = centre + 0.7 * (p[:, 20:] - centre)
    expected = 20 * 0.01**2 + 25 * 0.005**2
    assert guidance(p, alone).item() == pytest.approx(expected, rel=2e-2)
    # Within 8 mm alone: the 20 that are 10 mm off count as far as that, and are not drawn.
    assert guidance(p, alone, 0.008).item() == pytest.approx(
        20 * 0.008**2 + 25 * 0.005**2, rel=2e-2
    )
    drawn = p.clone().requires_grad_()
    guidance(drawn, alone, 0.008).sum().backward()
    assert (drawn.grad[:, :20] == 0).all()
    assert (drawn.grad[:, 20:].norm(dim=-1) > 0).all()


def test_tips_are_the_points_of_the_last_links(hand: HandModel) -> None:
    names = {hand.link_names[hand.inner_link[row]] for row in tips(hand).tolist()}
    assert names == {f"rh_{finger}distal" for finger in ("ff", "mf", "rf", "lf", "th")}
    assert len(tips(hand)) == 14  # three of each finger, two of the thumb


def test_guidance_draws_to_the_closest_object(scene: SceneObjects) -> None:
    p = around(torch.tensor([[[0.06, 0, 0.1]]] * 2), 0.05, 45)
    distance = scene.distance(p).numpy()
    expected = np.minimum(distance[0, 0] ** 2, distance[0, 1] ** 2).sum()
    assert guidance(p, scene)[0].item() == pytest.approx(expected)
    assert guidance(p, scene)[1].item() == pytest.approx((distance[1, 0] ** 2).sum())


def test_guidance_gradient(scene: SceneObjects) -> None:
    p = around(torch.tensor([[[0.05, 0, 0.1]]] * 2), 0.05, 45)
    analytic, differences = slope(lambda x: guidance(x, scene), p)
    assert analytic == pytest.approx(differences, rel=1e-4)


def fists(hand: HandModel) -> torch.Tensor:
    """An open hand, and random ones that mostly collide with themselves."""
    rng = np.random.default_rng(3)
    joints = np.concatenate([hand.open_joints[None], rng.uniform(hand.lower, hand.upper, (3, 18))])
    return torch.tensor(joints)


def test_self_collision_against_brute_force(hand: HandModel) -> None:
    T = HandKinematics(hand).forward(fists(hand))
    points = HandKinematics(hand).collision_points_of_links(T)
    measured = SelfCollision(hand).penetration(points, T).numpy()
    expected = np.zeros(4)
    for i in range(4):
        for link, grid in enumerate(hand.link_grids):
            others = ~hand.adjacency[link][hand.collision_link]
            local = apply(inverse(T[i, link]), points[i]).numpy()[others]
            expected[i] += (np.maximum(grid.distance(local), 0) ** 2).sum()
    assert measured == pytest.approx(expected, rel=1e-9, abs=1e-15)
    assert measured[0] == 0
    assert measured[1:].max() > 1e-5


def test_self_collision_is_one_of_the_meshes(hand: HandModel, scene: SceneObjects) -> None:
    T = HandKinematics(hand).forward(fists(hand)[1:3])
    T[:, :, 2, 3] += 1
    points = HandKinematics(hand).collision_points_of_links(T)
    own = SelfCollision(hand)
    alone = own.penetration(points, T) / (2000 * (torch.tensor([3.0, 2.0]) + hand.links))
    assert torch.allclose(collision(points, scene, T, own), alone)


def test_self_collision_gradient(hand: HandModel) -> None:
    kinematics, own = HandKinematics(hand), SelfCollision(hand)

    def loss(joints: torch.Tensor) -> torch.Tensor:
        T = kinematics.forward(joints)
        return own.penetration(kinematics.collision_points_of_links(T), T)

    analytic, differences = slope(loss, fists(hand))
    assert analytic == pytest.approx(differences, rel=1e-4)
    assert analytic != 0


def test_compiled_and_tensor_search_agree(hand: HandModel) -> None:
    T = HandKinematics(hand).forward(fists(hand)).repeat(8, 1, 1, 1)
    points = HandKinematics(hand).collision_points_of_links(T)
    own = SelfCollision(hand)
    found = torch.stack(own._near_compiled(points, T), dim=1)
    assert len(found) > 1024  # more than the first buffer
    assert torch.equal(found, own._inside(points, T).nonzero())
