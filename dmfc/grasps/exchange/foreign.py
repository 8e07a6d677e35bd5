"""What the readers of other projects' files give, and how they read numbers out of them."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from dmfc.errors import DmfcError
from dmfc.geometry.transforms import transform


@dataclass(frozen=True)
class ForeignGrasps:
    """n grasps as a file has them, in metres and radians."""

    T_object_root: np.ndarray
    """[n, 4, 4] pose of their hand's root in the frame of their object."""
    joints: np.ndarray
    """[n, J] angles, in the order of their hand."""
    where: list[str]
    """[n] file and number of each, for messages."""
    scales: np.ndarray = field(default_factory=lambda: np.zeros(0))
    """[n] size of the object that each is for, metres; empty where the format says none."""

    def __getitem__(self, rows: np.ndarray) -> ForeignGrasps:
        return ForeignGrasps(
            self.T_object_root[rows],
            self.joints[rows],
            [self.where[row] for row in rows],
            self.scales[rows] if len(self.scales) else self.scales,
        )

    def of_size(self, wanted: float | None, source: Path) -> ForeignGrasps:
        """Those made for one size of the object.

        Raises DmfcError if there are several sizes and none is asked for, or not the one asked for.
        """
        sizes = ", ".join(f"{size:g}" for size in np.unique(self.scales)[:8])
        if wanted is None:
            if len(np.unique(self.scales)) > 1:
                raise DmfcError(
                    f"{source}: grasps for several sizes of the object ({sizes}): choose "
                    "one with --scale"
                )
            return self
        if not len(self.scales):
            raise DmfcError(f"{source}: this format says no size of the object (option --scale)")
        rows = np.flatnonzero(np.isclose(self.scales, wanted, rtol=1e-3))
        if not len(rows):
            raise DmfcError(f"{source}: no grasp for --scale {wanted:g}; there are {sizes}")
        return self[rows]


def numbers(value: Any, count: int | None, place: str, what: str) -> np.ndarray:
    """A row of finite numbers, [count]. Raises DmfcError with `place` for anything else."""
    try:
        found = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise DmfcError(f"{place}: {what} is not a row of numbers") from error
    if found.ndim != 1 or count not in (None, len(found)) or not np.isfinite(found).all():
        expected = "finite numbers" if count is None else f"{count} finite numbers"
        raise DmfcError(f"{place}: {what} must be {expected}")
    return found


def size(value: Any, place: str, what: str) -> float:
    """A length above 0. Raises DmfcError with `place` for anything else."""
    single = not isinstance(value, list | tuple | dict) and np.ndim(value) == 0
    found = float(numbers([value] if single else value, 1, place, what)[0])
    if found <= 0:
        raise DmfcError(f"{place}: {what} is {found:g}, not a size")
    return found


def pose(position: np.ndarray, quaternion: np.ndarray, place: str, what: str) -> np.ndarray:
    """[4, 4] of a position and a quaternion w x y z. Raises DmfcError if it is no rotation."""
    if not 0.5 < np.linalg.norm(quaternion) < 2:
        raise DmfcError(
            f"{place}: the quaternion of {what} has length {np.linalg.norm(quaternion):.3g}, not 1"
        )
    return transform(Rotation.from_quat(quaternion, scalar_first=True).as_matrix(), position)
