"""Statistics of grasp sets against closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from dmfc.grasps.grasp_set import GraspSet
from dmfc.grasps.stats import approach_coverage, overall_row, set_row


def some(count: int, **changes) -> GraspSet:
    """Grasps that all approach along +z of the object, Q1 0, 1, 2, ..."""
    values = {
        "position": np.zeros((count, 3)),
        "rotation": np.tile(np.eye(3), (count, 1, 1)),
        "joints": np.zeros((count, 1)),
        "palm_hit": np.zeros((count, 3)),
        "q1": np.arange(count),
        "penetration": np.full(count, 0.001),
        "robustness": np.ones(count),
        "contacts": np.full(count, 4),
    }
    notes = {"proposed": "100", "checked": "20", "held": "5", "object_digest": "12ab"}
    names = {"object_id": "a/b", "hand": "claw", "dof_names": ["j"]}
    return GraspSet(**names, notes=notes, **values | changes)


def test_coverage_is_the_area_of_the_cones():
    """Caps of the unit sphere: 2 pi (1 - cos) of 4 pi each, where they do not overlap."""
    cap = (1 - np.cos(np.pi / 6)) / 2
    axes = np.concatenate([np.eye(3), -np.eye(3)])
    assert approach_coverage(np.zeros((0, 3))) == 0
    assert approach_coverage(axes[:1]) == pytest.approx(cap, abs=0.003)
    assert approach_coverage(np.repeat(axes[:1], 9, axis=0)) == pytest.approx(cap, abs=0.003)
    assert approach_coverage(axes) == pytest.approx(6 * cap, abs=0.006)
    assert approach_coverage(axes, cone=np.pi / 2) == 1


def test_a_row_has_counts_yield_and_medians():
    row = set_row(some(5), np.array([0, 0, 1.0]))
    assert (row["grasps"], row["checked"], row["yield"]) == (5, 20, 0.25)
    assert (row["q1_median"], row["contacts"], row["robustness"]) == (2, 4, 1)
    assert row["penetration_mm"] == pytest.approx(1)
    assert row["approach_coverage"] == approach_coverage(np.array([[0, 0, 1.0]]))


def test_what_was_not_measured_is_unknown_not_zero():
    unknown = {name: np.full(2, np.nan) for name in ("q1", "penetration", "robustness", "contacts")}
    row = set_row(some(2, **unknown), np.array([0, 0, 1.0]))
    assert row["q1_median"] is row["penetration_mm"] is row["robustness"] is None
    half = set_row(some(2, q1=np.array([np.nan, 0.5])), np.array([0, 0, 1.0]))
    assert half["q1_median"] == 0.5
    assert set_row(some(0), np.array([0, 0, 1.0]))["q1_median"] is None


def test_the_last_row_pools_grasps_and_sums_counts():
    turned = np.tile(np.diag([1.0, -1, -1]), (3, 1, 1))
    sets = [some(5), some(3, rotation=turned, q1=np.full(3, 9.0)), some(0)]
    row = overall_row(sets, np.array([0, 0, 1.0]))
    assert (row["object"], row["grasps"], row["proposed"], row["held"]) == ("all 3", 8, 300, 15)
    assert row["yield"] == 0.25
    assert row["q1_median"] == np.median([0, 1, 2, 3, 4, 9, 9, 9])
    assert row["approach_coverage"] == approach_coverage(np.array([[0, 0, 1.0]]))
