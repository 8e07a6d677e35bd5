"""The distance grid against closed forms and SciPy's interpolation."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import RegularGridInterpolator

from dmfc.geometry.grid import Grid


def sphere(points: np.ndarray) -> np.ndarray:
    return 0.04 - np.linalg.norm(points, axis=-1)


@pytest.fixture
def grid() -> Grid:
    return Grid.sample(sphere, np.full(3, -0.06), np.array([0.06, 0.07, 0.08]), 0.004)


def test_nodes_cover_the_box_and_keep_their_values(grid: Grid) -> None:
    assert (grid.upper >= [0.06, 0.07, 0.08]).all()
    assert (grid.upper < np.array([0.06, 0.07, 0.08]) + 0.004).all()
    node = grid.origin + grid.spacing * np.array([3, 5, 7])
    assert grid.distance(node) == pytest.approx(grid.values[3, 5, 7], abs=1e-12)
    assert grid.distance(grid.upper) == pytest.approx(grid.values[-1, -1, -1], abs=1e-12)


def test_inside_as_scipy(grid: Grid) -> None:
    points = np.random.default_rng(0).uniform(grid.origin, grid.upper, (500, 3))
    axes = [
        o + grid.spacing * np.arange(n) for o, n in zip(grid.origin, grid.values.shape, strict=True)
    ]
    exact = RegularGridInterpolator(axes, grid.values.astype(float))(
        np.minimum(points, [a[-1] for a in axes])
    )
    assert np.abs(grid.distance(points) - exact).max() < 1e-12
    assert grid.distance(points.reshape(5, 100, 3)).shape == (5, 100)


def test_outside_is_continuous_negative_and_1_lipschitz(grid: Grid) -> None:
    rng = np.random.default_rng(1)
    points = rng.uniform(-0.3, 0.3, (4000, 3))
    outside = points[((points < grid.origin) | (points > grid.upper)).any(1)]
    assert (grid.distance(outside) < 0).all()
    direction = rng.normal(size=points.shape)
    step = 1e-3 * direction / np.linalg.norm(direction, axis=1, keepdims=True)
    change = np.abs(grid.distance(points + step) - grid.distance(points))
    # One along the box, one away from it: at most sqrt(2) together, next to the corner.
    assert change.max() < 1e-3 * 1.5


def test_gradient_of_a_sphere_points_inwards(grid: Grid) -> None:
    points = np.random.default_rng(2).normal(size=(300, 3))
    points *= 0.04 / np.linalg.norm(points, axis=1, keepdims=True)
    gradient = grid.gradient(points)
    inward = -points / 0.04
    assert (np.einsum("ij,ij->i", gradient, inward) > 0.99).all()


def test_arrays_round_trip(grid: Grid) -> None:
    again = Grid.from_arrays(grid.arrays("sdf"), "sdf")
    assert np.array_equal(again.values, grid.values)
    assert np.array_equal(again.origin, grid.origin)
    assert again.spacing == grid.spacing


def test_a_flat_grid_is_refused() -> None:
    with pytest.raises(ValueError, match="two nodes"):
        Grid(np.zeros((1, 4, 4)), np.zeros(3), 0.01)
    with pytest.raises(ValueError, match="spacing"):
        Grid(np.zeros((2, 4, 4)), np.zeros(3), 0.0)
