"""Each thing that can be wrong with a cloud, and the one line that says so."""

from __future__ import annotations

import numpy as np
import pytest

from dmfc.errors import DmfcError
from dmfc.geometry.units import UNITS
from dmfc.sensing.check_cloud import MIN_POINTS, answered, check_cloud, require_points


def test_a_clean_cloud_passes_unchanged(blob):
    found = check_cloud(blob)
    np.testing.assert_array_equal(found.points, blob)
    np.testing.assert_array_equal(found.rows, np.arange(len(blob)))


@pytest.mark.parametrize(
    ("scale", "unit", "told"),
    [
        (
            1000,
            "m",
            r"120 m across when read in metres: if .* millimetres say --unit mm, otherwise crop",
        ),
        (
            100,
            "m",
            r"12 m across when read in metres: if .* centimetres say --unit cm, otherwise crop",
        ),
        (1, "mm", r"if its numbers are metres say --unit m, otherwise it shows no object"),
        (1e-3, "m", r"it shows no object"),
        (1e9, "m", r"crop it to the objects"),
    ],
)
def test_a_wrong_unit_is_told(scale, unit, told):
    box = np.random.default_rng(0).uniform(size=(500, 3)) * [0.05, 0.05, 0.12]
    box[:2] = [0, 0, 0], [0.05, 0.05, 0.12]
    with pytest.raises(DmfcError, match=told):
        check_cloud(box * scale, unit)


def test_numbers_that_are_none_are_counted(blob):
    dirty = blob.copy()
    dirty[[3, 50], 1] = np.nan
    dirty[70] = np.inf
    with pytest.raises(DmfcError, match=r"3 of 3000 points are NaN or infinite.*--drop-invalid"):
        check_cloud(dirty)
    found = check_cloud(dirty, drop_invalid=True)
    assert len(found.points) == 2997
    assert not {3, 50, 70} & set(found.rows)
    np.testing.assert_array_equal(dirty[found.rows], found.points)


def test_too_few_points_are_told_with_the_reason(blob):
    with pytest.raises(DmfcError, match=f"the cloud has 127 points, at least {MIN_POINTS}"):
        check_cloud(blob[:127])
    dirty = np.where(np.arange(len(blob))[:, None] < 2900, np.nan, blob)
    with pytest.raises(DmfcError, match=r"100 points \(2900 were no answers\)"):
        check_cloud(dirty, drop_invalid=True)


@pytest.mark.parametrize(
    "wrong", [np.zeros((5, 4)), np.zeros(3), np.full((200, 3), "x"), np.zeros((0, 2))]
)
def test_other_arrays_are_refused(wrong):
    with pytest.raises(DmfcError, match=r"a cloud is an array of numbers \[N, 3\]"):
        check_cloud(wrong)


def test_an_unknown_unit_lists_the_known_ones(blob):
    with pytest.raises(
        DmfcError, match=r"unknown unit 'inches'; did you mean 'inch'\?.*cm, inch, m, mm"
    ):
        check_cloud(blob, "inches")


def far_away(blob, count, distance=9.0):
    """The blob with `count` more points on a wall of 3 m x 2 m."""
    wall = np.random.default_rng(0).uniform(size=(count, 3)) * [3, 0, 2] + [-1.5, distance, 0]
    return np.concatenate([blob, wall])


@pytest.mark.parametrize(("count", "distance"), [(1, 9.0), (1, 1e5), (1500, 3.0), (2900, 3.0)])
def test_a_flying_pixel_or_a_wall_is_to_be_cropped_and_is_no_other_unit(blob, count, distance):
    with pytest.raises(DmfcError, match=rf"crop away the {count} that are far") as told:
        check_cloud(far_away(blob, count, distance))
    assert "--unit" not in str(told.value)


def test_the_unit_is_judged_by_the_bulk_in_spite_of_a_flying_pixel(blob):
    with pytest.raises(DmfcError, match="if its numbers are millimetres say --unit mm"):
        check_cloud(far_away(blob, 1) * 1000)
    with pytest.raises(DmfcError, match="if its numbers are metres say --unit m,"):
        check_cloud(far_away(blob, 1), "mm")  # 9 mm across, which alone would pass


@pytest.mark.parametrize("unit", ["m", "cm", "mm", "inch"])
def test_no_advice_names_the_unit_that_was_given(blob, unit):
    for size in (1e-6, 1e-4, 30.0, 300.0, 5e4, 1e8):
        with pytest.raises(DmfcError, match="across when read in") as told:
            check_cloud(blob / UNITS[unit] * size, unit)
        assert f"--unit {unit}," not in str(told.value)


def test_points_at_the_origin_are_no_answers(blob):
    dirty = np.concatenate([np.zeros((7200, 3)), blob])
    with pytest.raises(DmfcError, match=r"7200 of 10200 points are exactly \(0, 0, 0\)"):
        check_cloud(dirty)
    found = check_cloud(dirty, drop_invalid=True)
    np.testing.assert_array_equal(found.points, blob)
    np.testing.assert_array_equal(found.rows, np.arange(7200, 10200))
    assert len(answered(dirty[7199:]).points) == 3001  # one may be of the surface


def test_points_must_differ(blob):
    with pytest.raises(DmfcError, match="2000 points, but only 127 different ones"):
        check_cloud(np.resize(blob[:127], (2000, 3)))
    assert len(check_cloud(np.resize(blob[:128], (2000, 3))).points) == 2000
    late = np.concatenate([np.repeat(blob[:1], 5000, axis=0), blob[:200]])
    require_points(answered(late))


def test_float32_far_from_the_origin_is_told(blob):
    offset = np.array([5.4e6, 3.2e5, 100.0])
    with pytest.raises(DmfcError, match=r"float32 has steps of 0\.5.*float64, or subtract"):
        check_cloud((blob + offset).astype(np.float32))
    found = check_cloud(blob + offset)
    np.testing.assert_allclose(found.points - offset, blob, atol=1e-9)
    assert len(check_cloud((blob + np.array([100, 0, 0])).astype(np.float32)).points) == 3000


def test_numbers_beyond_any_size_are_one_line(blob):
    with pytest.raises(DmfcError, match="m across"):
        check_cloud(blob * 1e308)
