"""The atlas' two lookups against `Grid` and finite differences."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from dmfc.geometry import grid_atlas
from dmfc.geometry.grid import Grid
from dmfc.geometry.grid_atlas import FAR, GridAtlas
from dmfc.geometry.transforms import apply, inverse, transform
from tests.support.rotations import random_rotations


def ball(radius: float, spacing: float = 0.004) -> Grid:
    reach = np.array([radius + 0.01, radius + 0.02, radius + 0.03])
    return Grid.sample(lambda p: radius - np.linalg.norm(p, axis=-1), -reach, reach, spacing)


@pytest.fixture
def grids() -> list[Grid]:
    return [ball(0.03), ball(0.05, 0.006), ball(0.06)]


def problem(n: int = 5, k: int = 4, p: int = 200, dtype: torch.dtype = torch.float64):
    generator = torch.Generator().manual_seed(0)
    position = 0.1 * torch.randn(n * k, 3, generator=generator, dtype=dtype)
    T = transform(random_rotations(n * k, generator, dtype), position).reshape(n, k, 4, 4)
    index = torch.randint(-1, 3, (n, k), generator=generator)
    return 0.1 * torch.randn(n, p, 3, generator=generator, dtype=dtype), index, T


def test_distance_is_that_of_each_grid(grids: list[Grid]) -> None:
    points, index, T = problem()
    distance = GridAtlas(grids).distance(points, index, T)
    for i in range(5):
        for k in range(4):
            if index[i, k] < 0:
                assert (distance[i, k] == FAR).all()
                continue
            local = apply(inverse(T[i, k]), points[i]).numpy()
            assert np.allclose(grids[index[i, k]].distance(local), distance[i, k], atol=1e-12)


@pytest.mark.parametrize(("dtype", "tolerance"), [(torch.float64, 1e-12), (torch.float32, 1e-4)])
def test_compiled_and_tensor_paths_agree(
    grids: list[Grid], monkeypatch: pytest.MonkeyPatch, dtype: torch.dtype, tolerance: float
) -> None:
    monkeypatch.setattr(grid_atlas, "CHUNK", 1000)
    problem_ = problem(dtype=dtype)
    atlas = GridAtlas(grids)
    fast = grid_atlas._on_cpu(*problem_, atlas, True, False)
    slow = grid_atlas._by_tensors(*problem_, atlas, True)
    assert fast[0].dtype == slow[0].dtype == dtype
    assert (fast[0] - slow[0]).abs().max() < tolerance
    assert (fast[1] - slow[1]).abs().max() < tolerance
    for found, (alone, nothing) in (
        (fast, grid_atlas._on_cpu(*problem_, atlas, False, False)),
        (slow, grid_atlas._by_tensors(*problem_, atlas, False)),
    ):
        assert torch.equal(alone, found[0])
        assert nothing.numel() == 0


def test_near_gives_the_same_penetration_and_gradient(grids: list[Grid]) -> None:
    points, index, T = problem(p=2000)
    atlas, found = GridAtlas(grids), []
    for near in (False, True):
        moving = points.clone().requires_grad_()
        depth = atlas.distance(moving, index, T, near).clamp(min=0)
        found.append((depth.detach(), *torch.autograd.grad(depth.square().sum(), moving)))
    (depth, gradient), (near_depth, near_gradient) = found
    assert (depth > 0).sum() > 100
    assert torch.equal(depth, near_depth)
    assert torch.equal(gradient, near_gradient)


def test_gradient_by_finite_differences(grids: list[Grid]) -> None:
    points, index, T = problem(n=2, k=3, p=10)
    atlas = GridAtlas(grids)
    points.requires_grad_()
    assert torch.autograd.gradcheck(lambda x: atlas.distance(x, index, T), points, eps=1e-7)


def test_lookup_in_the_grids_own_frames(grids: list[Grid]) -> None:
    points = 0.05 * torch.randn(30, 3, generator=torch.Generator().manual_seed(1)).double()
    index = torch.arange(30) % 3
    distance = GridAtlas(grids).lookup(points, index)
    expected = [grids[i].distance(x) for i, x in zip(index.tolist(), points.numpy(), strict=True)]
    assert np.allclose(distance, expected, atol=1e-12)


def test_points_that_are_no_numbers_stay_so(grids: list[Grid]) -> None:
    points, index, T = problem(n=1, k=1)
    index[:] = 0
    points[0, 3, 1] = torch.nan
    atlas = GridAtlas(grids)
    for distance in (
        atlas.distance(points, index, T),
        atlas.distance(points, index, T, near=True),
        grid_atlas._by_tensors(points, index, T, atlas, True)[0],
    ):
        assert torch.equal(distance[0, 0].isnan().nonzero()[:, 0], torch.tensor([3]))


def test_no_grid_is_refused() -> None:
    with pytest.raises(ValueError, match="needs a grid"):
        GridAtlas([])
