"""The smallest picture of a grasp: where the palm is, and where it faces."""

from __future__ import annotations

import numpy as np

FINGER_M = 0.02
"""Length of the part that shows where the palm faces."""


def palm_glyphs(
    T_x_palm: np.ndarray, palm_reference: np.ndarray, palm_normal: np.ndarray
) -> np.ndarray:
    """[G, 3, 3] a polyline per palm pose T_x_palm [G, 4, 4], frame x: wrist, centre of the palm,
    where it faces. `palm_reference` and `palm_normal` [3] are the hand's, in the palm frame."""
    normal = np.asarray(palm_normal, dtype=np.float64)
    reference = np.asarray(palm_reference, dtype=np.float64)
    tip = reference + FINGER_M * normal / np.linalg.norm(normal)
    local = np.stack([np.zeros(3), reference, tip])
    return np.einsum("gij,pj->gpi", T_x_palm[:, :3, :3], local) + T_x_palm[:, None, :3, 3]
