"""Point operators against brute force, closed forms and scipy's tree."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from scipy.spatial import cKDTree

from dmfc.errors import DmfcError
from dmfc.geometry import points as ops


def cloud(shape: tuple[int, ...], dtype=np.float64, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-0.1, 0.1, shape).astype(dtype)


def grid_cloud(dtype=np.float64) -> np.ndarray:
    """A lattice in shuffled order: most distances occur many times, so ties decide."""
    axes = np.meshgrid(*[np.arange(5)] * 3, indexing="ij")
    lattice = np.stack(axes, -1).reshape(1, -1, 3)
    return np.random.default_rng(1).permutation(lattice, axis=1).astype(dtype)


def brute_farthest(points: np.ndarray, count: int) -> list[int]:
    chosen = [0]
    while len(chosen) < count:
        gaps = [min(sum((p - points[c]) ** 2) for c in chosen) for p in points]
        chosen.append(gaps.index(max(gaps)))
    return chosen


def brute_ball(points: np.ndarray, centre: np.ndarray, radius: float, count: int) -> list[int]:
    inside = [i for i, p in enumerate(points) if sum((p - centre) ** 2) < radius**2][:count]
    first = inside[0] if inside else 0
    return inside + [first] * (count - len(inside))


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("make", [lambda t: cloud((2, 60, 3), t), grid_cloud])
def test_farthest_points_equal_brute_force(make, dtype):
    points = make(dtype)
    expected = np.array([brute_farthest(p, 24) for p in points])
    np.testing.assert_array_equal(ops.farthest_points(points, 24), expected)
    tensor_path = ops._farthest_points_torch(torch.from_numpy(points), 24)
    np.testing.assert_array_equal(tensor_path.numpy(), expected)


def test_farthest_points_nest():
    points = cloud((2, 500, 3), np.float32)
    sample = ops.farthest_points(points, 128)
    np.testing.assert_array_equal(ops.farthest_points(points, 32), sample[:, :32])
    again = ops.farthest_points(ops.take_points(points, sample), 32)
    np.testing.assert_array_equal(again, np.broadcast_to(np.arange(32), (2, 32)))


def test_farthest_points_cover_the_cloud():
    points = cloud((400, 3))
    sample = points[ops.farthest_points(points, 40)]
    reach = cKDTree(sample).query(points)[0].max()
    between = cKDTree(sample).query(sample, k=2)[0][:, 1].min()
    assert reach <= between  # a greedy sample is a packing and a covering of the same radius


def test_farthest_points_of_a_small_cloud_is_an_error():
    with pytest.raises(DmfcError, match=r"network\.levels"):
        ops.farthest_points(cloud((4, 3)), 5)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize(("size", "count"), [(300, 16), (20, 32)])
def test_ball_query_equals_brute_force(dtype, size, count):
    points = cloud((2, size, 3), dtype)
    centres = np.concatenate([points[:, :15], np.full((2, 1, 3), 9.0, dtype)], 1)
    expected = np.array(
        [
            [brute_ball(p, c, dtype(0.06), count) for c in cs]
            for p, cs in zip(points, centres, strict=True)
        ]
    )
    np.testing.assert_array_equal(ops.ball_query(points, centres, 0.06, count), expected)
    tensor_path = ops._ball_query_torch(
        torch.from_numpy(points), torch.from_numpy(centres), 0.06, count
    )
    np.testing.assert_array_equal(tensor_path.numpy(), expected)


def test_ball_query_holds_all_neighbours_of_scipys_tree():
    points = cloud((500, 3))
    index = ops.ball_query(points, points[:50], 0.05, 500)
    near_lists = cKDTree(points).query_ball_point(points[:50], 0.05)
    for row, near in zip(index, near_lists, strict=True):
        assert sorted(set(row.tolist())) == sorted(near)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_three_nearest_equal_scipys_tree(dtype):
    points, queries = cloud((2, 40, 3), dtype), cloud((2, 100, 3), dtype, seed=2)
    index, weights = ops.three_nearest(points, queries)
    for b in range(2):
        distance, expected = cKDTree(points[b]).query(queries[b], k=3)
        np.testing.assert_array_equal(index[b], expected)
        inverse = distance**-2.0
        np.testing.assert_allclose(weights[b], inverse / inverse.sum(1, keepdims=True), rtol=1e-4)
    tensors = torch.from_numpy(points), torch.from_numpy(queries)
    np.testing.assert_array_equal(ops._three_nearest_torch(*tensors).numpy(), index)


def test_three_nearest_ties_take_the_lowest_index():
    points = grid_cloud()
    index, _ = ops.three_nearest(points, points)
    squared = ((points[0][:, None] - points[0][None]) ** 2).sum(-1)
    np.testing.assert_array_equal(index[0], np.argsort(squared, axis=1, kind="stable")[:, :3])


def test_interpolation_at_a_source_point_gives_its_value():
    points = cloud((40, 3))
    index, weights = ops.three_nearest(points, points)
    values = (ops.take_points(points, index) * weights[..., None]).sum(1)
    np.testing.assert_allclose(values, points, atol=1e-6)


def test_three_nearest_of_two_points_is_an_error():
    with pytest.raises(DmfcError, match="at least 3"):
        ops.three_nearest(cloud((2, 3)), cloud((4, 3)))


def test_numpy_and_torch_single_and_batch_agree():
    points = cloud((3, 200, 3), np.float32)
    tensors = torch.from_numpy(points)
    batch = ops.farthest_points(tensors, 16)
    assert batch.dtype == torch.int64
    np.testing.assert_array_equal(batch.numpy(), ops.farthest_points(points, 16))
    np.testing.assert_array_equal(batch[1].numpy(), ops.farthest_points(points[1], 16))
    centres = ops.take_points(tensors, batch)
    np.testing.assert_array_equal(centres[2].numpy(), points[2][batch[2].numpy()])
    balls = ops.ball_query(tensors, centres, 0.03, 8)
    np.testing.assert_array_equal(
        balls[0].numpy(), ops.ball_query(points[0], centres[0].numpy(), 0.03, 8)
    )
    index, weights = ops.three_nearest(centres[0], tensors[0])
    assert index.shape == weights.shape == (200, 3)
    assert weights.dtype == torch.float32
