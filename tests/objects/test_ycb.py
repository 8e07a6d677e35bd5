"""The 16 YCB test objects, prepared with the default settings. Minutes: marked `full`."""

from __future__ import annotations

import pytest

from dmfc.config.objects import PrepareConfig
from dmfc.objects.prepare import prepare
from dmfc.objects.sources import YCB_TEST, find_object
from tests.objects.test_prepare import band_error


@pytest.mark.full
@pytest.mark.parametrize("name", YCB_TEST)
def test_distance_within_a_millimetre(name):
    """Against an exact mesh query, at 20,000 points within 2 cm of the surface."""
    model = prepare(find_object(f"ycb:{name}"), PrepareConfig(sdf_spacing=0.0014))
    assert band_error(model, 0.02, count=20_000) < 0.001
    assert len(model.convex_parts) <= PrepareConfig.convex_max_parts
    upright = model.stable_rotations[model.standard_pose]
    assert upright[2, 2] > 0.99
