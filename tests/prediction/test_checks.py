"""Each thing that can be wrong with a cloud, and the one line that says so."""

from __future__ import annotations

import numpy as np
import pytest

from dmfc.errors import DmfcError
from dmfc.prediction.checks import MIN_POINTS, check_cloud


def test_a_clean_cloud_passes_unchanged(blob):
    found = check_cloud(blob)
    np.testing.assert_array_equal(found.points, blob)
    np.testing.assert_array_equal(found.rows, np.arange(len(blob)))


@pytest.mark.parametrize(
    ("scale", "unit", "told"),
    [
        (1000, "m", r"120 m across when read in m: looks like millimetres: --unit mm"),
        (1, "mm", r"looks like metres: --unit m$"),
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
    with pytest.raises(DmfcError, match=r"100 points \(2900 were NaN or infinite\)"):
        check_cloud(dirty, drop_invalid=True)


@pytest.mark.parametrize(
    "wrong", [np.zeros((5, 4)), np.zeros(3), np.full((200, 3), "x"), np.zeros((0, 2))]
)
def test_other_arrays_are_refused(wrong):
    with pytest.raises(DmfcError, match=r"a cloud is an array of numbers \[N, 3\]"):
        check_cloud(wrong)


def test_an_unknown_unit_lists_the_known_ones(blob):
    with pytest.raises(DmfcError, match=r"unknown unit 'inch'.*cm, m, mm"):
        check_cloud(blob, "inch")
