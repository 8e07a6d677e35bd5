"""`RankedGrasps`: the answer of a planner for one cloud, and its files."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from dmfc.errors import DmfcError
from dmfc.grasps.grasps import Grasps

FINEST = 0.0005
"""Metres: a grasp set keeps positions at least so finely."""


@dataclass(frozen=True)
class RankedGrasps(Grasps):
    """G grasps, the most confident first, in the frame of the cloud.

    Joints are within the hand's limits; so the fingers are bent when they touch.
    """

    confidence: np.ndarray
    """[G] in (0, 1)."""
    point: np.ndarray
    """[G] i64 index of the point of the given cloud that the grasp was predicted at."""
    dof_names: list[str]
    """[D] joint that drives each degree of freedom."""
    hand: str
    """Name of the hand."""
    model: str
    """Name or folder of the model that predicted them."""

    @property
    def T_cloud_palm(self) -> np.ndarray:
        """[G, 4, 4] pose of the hand's palm frame."""
        return self.T

    def to_dict(self) -> dict[str, Any]:
        """All of it as JSON's types; a matrix is a list of rows."""
        T_cloud_palm = self.T
        return {
            "model": self.model,
            "hand": self.hand,
            "dof_names": self.dof_names,
            "grasps": [
                {
                    "confidence": float(self.confidence[k]),
                    "point": int(self.point[k]),
                    "T_cloud_palm": T_cloud_palm[k].tolist(),
                    "joints": self.joints[k].tolist(),
                }
                for k in range(len(self))
            ],
        }

    def to_json(self) -> str:
        """`to_dict` as text."""
        return json.dumps(self.to_dict())

    def save(self, path: Path | str, object_id: str = "cloud") -> None:
        """Write a grasp set (`dmfc.grasps.grasp_set`) in which the object's frame is the cloud's.

        Q1, penetration, robustness and contacts were not measured and are NaN. Rows keep their
        order; the notes `confidence` and `point` hold a number for each, with spaces between.
        Raises DmfcError where they lie too far from the origin for a grasp set.
        """
        from dmfc.grasps.grasp_set import GraspSet

        farthest = np.abs(self.T_cloud_palm[:, :3, 3]).max(initial=0.0)
        if np.spacing(np.float32(farthest)) > FINEST:
            raise DmfcError(
                f"the grasps lie {farthest:.3g} m from the origin, where a grasp set's float32 "
                "loses a millimetre: subtract an offset from the cloud, or take them as JSON"
            )
        count, unknown = len(self), np.full(len(self), np.nan)
        GraspSet(
            object_id=object_id,
            hand=self.hand,
            dof_names=self.dof_names,
            position=self.position,
            rotation=self.rotation,
            joints=self.joints,
            palm_hit=np.full((count, 3), np.nan),
            q1=unknown,
            penetration=unknown,
            robustness=unknown,
            contacts=unknown,
            notes={
                "predicted_by": self.model,
                "confidence": " ".join(f"{value:.6g}" for value in self.confidence),
                "point": " ".join(str(value) for value in self.point),
            },
        ).save(Path(path))
