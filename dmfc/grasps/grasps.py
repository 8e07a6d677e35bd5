"""`Grasps`: where the palm is and how the fingers are bent, n times. Other records extend it."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Self

import numpy as np

from dmfc.geometry.transforms import transform


@dataclass(frozen=True)
class Grasps:
    """n grasps of one hand in one frame; metres, radians, float64."""

    position: np.ndarray
    """[n, 3] origin of the palm frame."""
    rotation: np.ndarray
    """[n, 3, 3] its axes as columns: R_frame_palm."""
    joints: np.ndarray
    """[n, D] joint angles."""

    def __len__(self) -> int:
        return len(self.position)

    def __getitem__(self, rows: np.ndarray | slice) -> Self:
        """The grasps of some rows (indices, mask or slice), with all columns that are arrays."""
        columns = {
            entry.name: value[rows]
            for entry in dataclasses.fields(self)
            if isinstance(value := getattr(self, entry.name), np.ndarray)
        }
        return dataclasses.replace(self, **columns)

    @property
    def T(self) -> np.ndarray:
        """[n, 4, 4] T_frame_palm."""
        return transform(self.rotation, self.position)

    def in_frame(self, T_new_frame: np.ndarray) -> Grasps:
        """The same palms and joints seen from another frame, [4, 4], without further columns."""
        R, origin = T_new_frame[:3, :3], T_new_frame[:3, 3]
        return Grasps(self.position @ R.T + origin, R @ self.rotation, self.joints)
