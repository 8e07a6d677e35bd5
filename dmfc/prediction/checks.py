"""What is checked of a user's cloud before the network sees it: each finding is one line."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dmfc.errors import DmfcError, unknown_name

UNITS = {"m": 1.0, "cm": 0.01, "mm": 0.001}
LARGEST, SMALLEST = 2.0, 0.005
"""Metres: no graspable scene is larger or smaller."""
MIN_POINTS = 128
"""Fewer do not show a shape."""


@dataclass(frozen=True)
class CheckedCloud:
    """Finite points [n, 3] in metres, float64, and their rows [n] in the cloud that was given."""

    points: np.ndarray
    rows: np.ndarray

    def __getitem__(self, chosen: np.ndarray) -> CheckedCloud:
        """Some of the points, by mask or indices."""
        return CheckedCloud(self.points[chosen], self.rows[chosen])


def check_cloud(points: np.ndarray, unit: str = "m", drop_invalid: bool = False) -> CheckedCloud:
    """The points of a user's array in metres.

    Raises DmfcError where it is no array [N, 3], where numbers are not finite (unless they are
    dropped), where too few points are left, or where their extent says that the unit is another.
    """
    if unit not in UNITS:
        raise unknown_name("unit", unit, UNITS)
    points = np.asarray(points)
    if points.ndim != 2 or points.shape[1] != 3 or points.dtype.kind not in "fiu":
        raise DmfcError(
            f"a cloud is an array of numbers [N, 3], not {points.dtype} {list(points.shape)}"
        )
    points = points.astype(np.float64)
    finite = np.isfinite(points).all(1)
    lost = int((~finite).sum())
    if lost and not drop_invalid:
        raise DmfcError(
            f"{lost} of {len(points)} points are NaN or infinite: leave them out with drop_invalid "
            "(--drop-invalid)"
        )
    cloud = CheckedCloud(points[finite] * UNITS[unit], np.flatnonzero(finite))
    require_points(cloud, f"{lost} were NaN or infinite" if lost else "")
    _check_extent(cloud.points, unit)
    return cloud


def require_points(cloud: CheckedCloud, why: str = "") -> None:
    """Raises DmfcError where there are fewer than `MIN_POINTS`; `why` some are missing."""
    count = len(cloud.points)
    if count < MIN_POINTS:
        because = f" ({why})" if why else ""
        raise DmfcError(
            f"the cloud has {count} points{because}, at least {MIN_POINTS} are needed: crop less "
            "of the object, or move the camera closer"
        )


def _check_extent(points: np.ndarray, unit: str) -> None:
    """The longest side of the cloud's box must be that of something on a table."""
    extent = float(np.ptp(points, axis=0).max())
    if SMALLEST <= extent <= LARGEST:
        return
    read = f"the cloud is {extent:.4g} m across when read in {unit}"
    fitting = [
        name
        for name in ("mm", "m", "cm")
        if SMALLEST <= extent / UNITS[unit] * UNITS[name] <= LARGEST
    ]
    if fitting:
        names = {"m": "metres", "cm": "centimetres", "mm": "millimetres"}
        raise DmfcError(f"{read}: looks like {names[fitting[0]]}: --unit {fitting[0]}")
    what = "crop it to the objects" if extent > LARGEST else "it shows no object"
    raise DmfcError(f"{read}, and a scene is {SMALLEST} to {LARGEST} m: {what} (--unit)")
