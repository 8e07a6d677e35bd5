"""Objects of a scene: distances, normals and centres."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
import torch

from dmfc.errors import DmfcError
from dmfc.geometry.transforms import apply, inverse
from dmfc.objects.atlas import ObjectAtlas, SceneObjects
from tests.support.loss_shapes import BALL, ball_distance, box_distance


def points(n: int = 2, count: int = 300) -> torch.Tensor:
    generator = torch.Generator().manual_seed(1)
    spread = 0.05 * torch.randn(n, count, 3, generator=generator, dtype=torch.float64)
    return spread + torch.tensor([0.05, 0, 0.1])


def test_distances_of_a_scene(scene: SceneObjects) -> None:
    p = points()
    distance = scene.distance(p)
    T = inverse(scene.T_world_object)
    ball = ball_distance(apply(T[0, 0], p[0]).numpy())
    box = box_distance(apply(T[0, 1], p[0]).numpy())
    near = ball > -0.015
    assert np.abs(distance[0, 0].numpy() - ball)[near].max() < 1e-4
    near = box > -0.015
    # Half a voxel of the edge is cut.
    assert np.abs(distance[0, 1].numpy() - box)[near].max() < 5e-4
    assert (distance[1, 1] == -10).all()
    assert (distance[0, 0].numpy()[ball < 0] < 1e-4).all()
    assert scene.count.tolist() == [2, 1]


def test_normals_of_a_ball_point_out(scene: SceneObjects) -> None:
    p = points()
    distance, normals = scene.surface(p)
    assert torch.equal(distance, scene.distance(p))
    outward = p[0] - scene.T_world_object[0, 0, :3, 3]
    near = (outward.norm(dim=-1) > 0.01) & (outward.norm(dim=-1) < 0.055)
    expected = torch.nn.functional.normalize(outward, dim=-1)
    assert ((normals[0, 0] * expected).sum(-1)[near] > 0.999).all()
    assert near.sum() > 20


def test_normals_turn_with_the_surface(scene: SceneObjects) -> None:
    """Along a ball of radius r a normal turns by 1/r per metre."""
    ball = scene.only(torch.tensor([0, 0])).take(torch.tensor([0]))
    centre = ball.T_world_object[0, 0, :3, 3]
    turns = []
    for i in range(20):
        generator = torch.Generator().manual_seed(i)
        out, side = torch.randn(2, 3, generator=generator, dtype=torch.float64)
        out = out / out.norm()
        side = torch.linalg.cross(out, side)
        side = side / side.norm()
        p = (centre + BALL * out)[None, None].requires_grad_()
        (gradient,) = torch.autograd.grad((ball.surface(p)[1][0, 0, 0] * side).sum(), p)
        turns.append((gradient[0, 0] * side).sum().item())
    assert np.mean(turns) == pytest.approx(1 / BALL, rel=0.05)


def test_centres_and_selection(scene: SceneObjects) -> None:
    only = scene.only(torch.tensor([1, 0]))
    assert only.index[:, 0].tolist() == [1, 0]
    box = scene.T_world_object[0, 1]
    expected = box[:3, :3] @ torch.tensor([0, 0, 0.01], dtype=torch.float64) + box[:3, 3]
    assert torch.allclose(only.centres[0, 0], expected)
    taken = scene.take(torch.tensor([1, 1, 0]))
    assert taken.index.tolist() == [[0, -1], [0, -1], [0, 1]]


def test_atlas_of_objects(atlas: ObjectAtlas) -> None:
    grid = SimpleNamespace(id="a", sdf=_grid(atlas), com=np.zeros(3))
    assert ObjectAtlas.of([grid]).ids == ["a"]
    with pytest.raises(DmfcError, match="'a' comes twice"):
        ObjectAtlas.of([grid, grid])
    with pytest.raises(DmfcError, match=r"objects\.train"):
        ObjectAtlas.of([])


def _grid(atlas: ObjectAtlas):
    from dmfc.geometry.grid import Grid

    return Grid(atlas.grids.values[:8].reshape(2, 2, 2).numpy(), np.zeros(3), 0.01)
