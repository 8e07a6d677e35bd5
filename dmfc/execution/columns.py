"""The columns of a trial table that hold its grasp; `dmfc.outcome.trials` reads them back."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from dmfc.execution.candidates import GraspCandidates
from dmfc.outcome.trials import POSITION, QUATERNION, joint_columns


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
