"""The columns of a trial table that tell its grasp, written and read back."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.spatial.transform import Rotation

from dmfc.execution.candidates import GraspCandidates

if TYPE_CHECKING:
    import pandas as pd

POSITION = ("palm_x", "palm_y", "palm_z")
"""World frame, metres."""
QUATERNION = ("palm_qw", "palm_qx", "palm_qy", "palm_qz")
"""Unit quaternion of R_world_palm, w >= 0."""


def joint_columns(dofs: int) -> list[str]:
    """Names of the columns of the joint angles, rad, in the order of the hand's."""
    return [f"joint_{k:02d}" for k in range(dofs)]


def grasp_columns(grasps: GraspCandidates, row: int, dofs: int) -> dict[str, Any]:
    """The grasp in a row of candidates as columns; NaN, and no seed point, beyond their end."""
    if row >= len(grasps):
        names = ("confidence", "score", *POSITION, *QUATERNION, *joint_columns(dofs))
        return {"seed_point": -1, **dict.fromkeys(names, float("nan"))}
    turn = Rotation.from_matrix(grasps.rotation[row]).as_quat(canonical=True)
    return {
        "seed_point": int(grasps.seed_point[row]),
        "confidence": float(grasps.confidence[row]),
        "score": float(grasps.score[row]),
        **dict(zip(POSITION, map(float, grasps.position[row]), strict=True)),
        **dict(zip(QUATERNION, map(float, np.roll(turn, 1)), strict=True)),
        **dict(zip(joint_columns(dofs), map(float, grasps.joints[row]), strict=True)),
    }


def grasps_of_rows(rows: pd.DataFrame, object_index: np.ndarray) -> GraspCandidates:
    """The grasps of rows that have one, with the object of its scene [n] that each aims at."""
    joints = [name for name in rows if str(name).startswith("joint_")]
    turn = np.roll(rows[list(QUATERNION)].to_numpy(np.float64), -1, axis=1)
    return GraspCandidates(
        position=rows[list(POSITION)].to_numpy(np.float64),
        rotation=Rotation.from_quat(turn).as_matrix().reshape(-1, 3, 3),
        joints=rows[joints].to_numpy(np.float64),
        confidence=rows["confidence"].to_numpy(np.float64),
        object_index=object_index,
        seed_point=rows["seed_point"].to_numpy(np.int64),
        score=rows["score"].to_numpy(np.float64),
    )
