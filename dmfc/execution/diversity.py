"""How different the grasps of a scene are from each other."""

from __future__ import annotations

import numpy as np
from scipy.spatial.distance import pdist

from dmfc.execution.candidates import GraspCandidates


def diversity(grasps: GraspCandidates) -> dict[str, float]:
    """Mean over all pairs of grasps of how far apart they are; NaN for fewer than two.

    position: distance of the palm origins, metres; rotation: angle between the palms, rad; joints:
    Euclidean distance of the joint angles, rad.
    """
    if len(grasps) < 2:
        return dict.fromkeys(("position", "rotation", "joints"), float("nan"))
    # |A - B|^2 = 6 - 2 tr(A^T B) for rotations, and tr(A^T B) = 1 + 2 cos(angle).
    squared = pdist(grasps.rotation.reshape(len(grasps), 9), "sqeuclidean")
    angle = np.arccos(np.clip(1 - squared / 4, -1.0, 1.0))
    return {
        "position": float(pdist(grasps.position).mean()),
        "rotation": float(angle.mean()),
        "joints": float(pdist(grasps.joints).mean()),
    }
