"""Statistics of grasp sets: counts, yield, quality, and coverage of approach directions."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

import numpy as np

from dmfc.grasps.grasp_set import GraspSet

CONE = np.pi / 6
"""rad; a direction counts as covered if a grasp approaches within this angle of it."""
_DIRECTIONS = 1000


def approach_coverage(directions: np.ndarray, cone: float = CONE) -> float:
    """Share of the sphere within `cone` rad of one of the unit vectors [n, 3]; 0 for none.

    Measured at 1,000 directions of a Fibonacci lattice, which are equally spread. One grasp covers
    (1 - cos cone) / 2, that is 6.7 % at 30 degrees; 1 is a grasp from every side.
    """
    if not len(directions):
        return 0.0
    steps = np.arange(_DIRECTIONS)
    z = 1 - (2 * steps + 1) / _DIRECTIONS
    turn = np.pi * (1 + np.sqrt(5)) * steps
    ring = np.sqrt(1 - z**2)
    lattice = np.stack([ring * np.cos(turn), ring * np.sin(turn), z], axis=1)
    return float(((lattice @ directions.T).max(axis=1) >= np.cos(cone)).mean())


def set_row(grasps: GraspSet, palm_normal: np.ndarray) -> dict[str, Any]:
    """One object's row; palm_normal [3] in the palm frame. None stands for what is not known.

    `yield` is the share of physics checks that held; `proposed`, `checked` and `held` are counts of
    the planner.
    """
    counts = {name: _count(grasps, name) for name in ("proposed", "checked", "held")}
    return {
        "object": grasps.object_id,
        "grasps": len(grasps),
        **counts,
        "yield": _share(counts["held"], counts["checked"]),
        "robustness": _mean(grasps.robustness),
        "q1_median": _median(grasps.q1),
        "penetration_mm": _scaled(_median(grasps.penetration), 1e3),
        "contacts": _mean(grasps.contacts),
        "approach_coverage": approach_coverage(grasps.rotation @ palm_normal),
    }


def overall_row(sets: Sequence[GraspSet], palm_normal: np.ndarray) -> dict[str, Any]:
    """The row over all objects: counts are sums, qualities those of all grasps, coverage the median
    over the objects."""
    rows = [set_row(grasps, palm_normal) for grasps in sets]
    counts = {name: sum(row[name] or 0 for row in rows) for name in ("proposed", "checked", "held")}

    def of_all(name: str) -> np.ndarray:
        return np.concatenate([getattr(grasps, name) for grasps in sets])

    return {
        "object": f"all {len(rows)}",
        "grasps": sum(row["grasps"] for row in rows),
        **counts,
        "yield": _share(counts["held"], counts["checked"]),
        "robustness": _mean(of_all("robustness")),
        "q1_median": _median(of_all("q1")),
        "penetration_mm": _scaled(_median(of_all("penetration")), 1e3),
        "contacts": _mean(of_all("contacts")),
        "approach_coverage": float(np.median([row["approach_coverage"] for row in rows])),
    }


def _count(grasps: GraspSet, name: str) -> int | None:
    text = grasps.notes.get(name, "")
    return int(text) if re.fullmatch(r"\d+", text) else None


def _share(part: int | None, whole: int | None) -> float | None:
    return part / whole if part is not None and whole else None


def _mean(values: np.ndarray) -> float | None:
    known = values[~np.isnan(values)]
    return float(known.mean()) if len(known) else None


def _median(values: np.ndarray) -> float | None:
    known = values[~np.isnan(values)]
    return float(np.median(known)) if len(known) else None


def _scaled(value: float | None, factor: float) -> float | None:
    return None if value is None else factor * value
