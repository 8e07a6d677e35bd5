"""The record of foreign grasps, and how readers take numbers from files of other projects."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from dmfc.errors import DmfcError
from dmfc.geometry.transforms import transform
from dmfc.grasps.grasps import Grasps


@dataclass(frozen=True)
class ForeignGrasps(Grasps):
    """n grasps as a file has them: the root of its hand in the frame of its object, its joints."""

    where: np.ndarray
    """[n] file and number of each, for messages."""
    scales: np.ndarray
    """[n] size of the object that each is for, metres; NaN where the format has none."""

    @classmethod
    def of(
        cls,
        T_object_root: np.ndarray,
        joints: np.ndarray,
        where: Sequence[str],
        scales: Sequence[float] | None = None,
    ) -> ForeignGrasps:
        """From poses [n, 4, 4] and joints [n, J]; without scales where the format has none."""
        return cls(
            position=T_object_root[:, :3, 3],
            rotation=T_object_root[:, :3, :3],
            joints=joints,
            where=np.array(where),
            scales=np.full(len(joints), np.nan) if scales is None else np.array(scales),
        )

    @property
    def has_scales(self) -> bool:
        """Whether the format says for which size of the object a grasp is."""
        return bool(np.isfinite(self.scales).all())

    def of_size(self, wanted: float | None, source: Path) -> ForeignGrasps:
        """Those made for one size of the object.

        Raises DmfcError if there are several sizes and none is asked for, or not the one asked for.
        """
        sizes = ", ".join(f"{size:g}" for size in np.unique(self.scales)[:8])
        if wanted is None:
            if self.has_scales and len(np.unique(self.scales)) > 1:
                raise DmfcError(
                    f"{source}: grasps for several sizes of the object ({sizes}): choose "
                    "one with --scale"
                )
            return self
        if not self.has_scales:
            raise DmfcError(f"{source}: this format has no size of the object (option --scale)")
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
