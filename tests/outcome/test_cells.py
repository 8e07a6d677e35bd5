"""The search by cells against a k-d tree."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from dmfc.outcome.cells_kernel import fill_cells, nearest


def test_the_nearest_point_within_the_radius_is_found() -> None:
    generator = np.random.default_rng(0)
    points, radius = generator.uniform(-0.2, 0.2, (700, 3)), 0.03
    places = generator.uniform(-0.3, 0.3, (500, 3))
    distance, index = cKDTree(points).query(places)
    cells = fill_cells(points, radius)
    found = [nearest(*place, points, radius, *cells) for place in places]
    near = distance < radius
    assert 20 < near.sum() < 480
    assert [p for p, _ in found] == np.where(near, index, -1).tolist()
    np.testing.assert_allclose([d for _, d in found], np.minimum(distance, radius), atol=1e-12)
