"""Checks of a user's cloud before any computation; each problem is one line."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dmfc.errors import DmfcError
from dmfc.geometry.units import UNITS, metres

LARGEST, SMALLEST = 2.0, 0.005
"""Metres: no graspable scene is larger or smaller."""
MIN_POINTS = 128
"""Fewer different points do not show a shape."""
STEPS = 200
"""Steps of its numbers that the size of a cloud must have at least."""
NAMES = {"mm": "millimetres", "m": "metres", "cm": "centimetres", "inch": "inches"}
"""Units, the likelier first."""


@dataclass(frozen=True)
class CheckedCloud:
    """Finite points [n, 3] in metres, float64, and their rows [n] in the cloud that was given."""

    points: np.ndarray
    rows: np.ndarray

    def __getitem__(self, chosen: np.ndarray) -> CheckedCloud:
        """Some of the points, by mask or indices."""
        return CheckedCloud(self.points[chosen], self.rows[chosen])


def check_cloud(points: np.ndarray, unit: str = "m", drop_invalid: bool = False) -> CheckedCloud:
    """The points of a user's array in metres. Raises DmfcError as `answered`,
    `require_points` and `check_extent` do."""
    cloud = answered(points, unit, drop_invalid)
    lost = len(points) - len(cloud.points)
    require_points(cloud, f"{lost} were no answers" if lost else "")
    check_extent(cloud.points, unit)
    return cloud


def answered(points: np.ndarray, unit: str = "m", drop_invalid: bool = False) -> CheckedCloud:
    """The points of `points` [N, 3], in `unit`, where the sensor saw something.

    Where it saw nothing, drivers write NaN, infinity, or the origin, which is no surface if several
    points are exactly there. Raises DmfcError where there are such points, unless they are dropped,
    where `points` is no array [N, 3] or the unit is unknown, and where its float32 numbers are too
    far from zero to show a shape.
    """
    scale = metres(unit)
    points = np.asarray(points)
    if points.ndim != 2 or points.shape[1] != 3 or points.dtype.kind not in "fiu":
        raise DmfcError(
            f"a cloud is an array of numbers [N, 3], not {points.dtype} {list(points.shape)}"
        )
    finite, at_origin = np.isfinite(points).all(1), (points == 0).all(1)
    if at_origin.sum() == 1 and not drop_invalid:
        at_origin[:] = False
    for invalid, what in (
        (~finite, "NaN or infinite"),
        (at_origin, "exactly (0, 0, 0), which sensors write for 'no answer'"),
    ):
        if invalid.any() and not drop_invalid:
            raise DmfcError(
                f"{int(invalid.sum())} of {len(points)} points are {what}: leave them out with "
                "drop_invalid (--drop-invalid)"
            )
    valid = finite & ~at_origin
    _check_steps(points[valid])
    return CheckedCloud(points[valid].astype(np.float64) * scale, np.flatnonzero(valid))


def require_points(cloud: CheckedCloud, why: str = "") -> None:
    """Raises DmfcError for fewer than `MIN_POINTS` different points; `why` some are missing."""
    points = cloud.points
    count = len(points)
    because = f" ({why})" if why else ""
    if count < MIN_POINTS:
        raise DmfcError(
            f"the cloud has {count} points{because}, at least {MIN_POINTS} are needed: crop less "
            "of the object, or move the camera closer"
        )
    if _different(points[: 16 * MIN_POINTS]) < MIN_POINTS and _different(points) < MIN_POINTS:
        raise DmfcError(
            f"the cloud has {count} points{because}, but only {_different(points)} different ones: "
            f"at least {MIN_POINTS} are needed"
        )


def _different(points: np.ndarray) -> int:
    return len(np.unique(points, axis=0))


def _check_steps(points: np.ndarray) -> None:
    """float32 numbers far from zero come in steps: 0.5 m in the coordinates of a map."""
    if points.dtype.kind != "f" or points.dtype.itemsize > 4 or not len(points):
        return
    farthest = np.abs(points).max()
    step, extent = float(np.spacing(farthest)), float(np.ptp(points.astype(np.float64), 0).max())
    if step * STEPS > extent > 0:
        raise DmfcError(
            f"the cloud's numbers reach {farthest:.4g}, where {points.dtype} has steps of "
            f"{step:.2g}, and its size is {extent:.4g}: save it in float64, or subtract an offset "
            "before saving"
        )


def check_extent(points: np.ndarray, unit: str | None = "m") -> None:
    """Raises DmfcError unless the bulk of the points [N, 3], and all, are of a scene's size.

    `unit`: of the numbers that they were read from, None where that is no guess.
    """
    with np.errstate(over="ignore"):
        extent = float(np.ptp(points, axis=0).max())
        away = np.abs(points - np.median(points, axis=0)).max(1)
    bulk = 2 * float(np.median(away))  # side of the cube that holds half of the points
    read = f"the cloud is {extent:.4g} m across"
    read += f" when read in {NAMES[unit]}" if unit else ""
    if bulk > LARGEST or bulk < SMALLEST / 2 or extent < SMALLEST:
        raise DmfcError(f"{read}: {_advice(bulk, extent, unit)}")
    if extent > LARGEST:
        far = int((away > LARGEST / 2).sum())
        raise DmfcError(
            f"{read}, though half of its points lie within {bulk:.2g} m: crop away the {far} that "
            "are far from them (flying pixels, a wall, the floor)"
        )


def _advice(bulk: float, extent: float, unit: str | None) -> str:
    fitting = [
        f"if its numbers are {name} say --unit {other}"
        for other, name in NAMES.items()
        if unit and 4 * SMALLEST <= bulk / UNITS[unit] * UNITS[other] <= LARGEST / 2
    ]
    otherwise = f"it shows no object (half of its points lie within {bulk:.2g} m)"
    if extent > LARGEST:
        otherwise = "crop it to the objects"
    return ", otherwise ".join([*fitting[:1], otherwise])
