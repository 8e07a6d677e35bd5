"""Poses of the links of many hands by a compiled loop: forward kinematics without gradients."""

from __future__ import annotations

import numpy as np
from numba import njit

from dmfc.hand.model import HandModel


def link_poses(hand: HandModel, joints: np.ndarray) -> np.ndarray:
    """T_palm_link [n, L, 4, 4] of joints [n, D] rad; angles are not clamped to the limits."""
    return pose_links(
        hand.parents,
        hand.T_parent_link,
        hand.joint_axis,
        hand.joint_dof,
        hand.joint_scale,
        np.ascontiguousarray(joints, dtype=np.float64),
    )


@njit(cache=True, nogil=True)
def pose_links(
    parents: np.ndarray,
    T_parent_link: np.ndarray,
    axis: np.ndarray,
    dof: np.ndarray,
    scale: np.ndarray,
    joints: np.ndarray,
) -> np.ndarray:
    """T_palm_link [n, L, 4, 4]: T_palm_parent @ T_parent_link @ turn(axis, scale * joint)."""
    count, links = joints.shape[0], parents.shape[0]
    T = np.zeros((count, links, 4, 4))
    step, turn = np.zeros((4, 4)), np.zeros((4, 4))
    for i in range(count):
        for k in range(links):
            angle = scale[k] * joints[i, dof[k]] if dof[k] >= 0 else 0.0
            _turned(T_parent_link[k], axis[k], angle, turn, step)
            if parents[k] < 0:
                T[i, k] = step
            else:
                _product(T[i, parents[k]], step, T[i, k])
    return T


@njit(cache=True, nogil=True)
def _turned(
    T: np.ndarray, axis: np.ndarray, angle: float, turn: np.ndarray, out: np.ndarray
) -> None:
    """out = T @ turn, by Rodrigues' formula; a zero axis does not turn."""
    c, s = np.cos(angle), np.sin(angle)
    x, y, z = axis[0], axis[1], axis[2]
    if x * x + y * y + z * z < 0.5:
        c, s = 1.0, 0.0
    v = 1.0 - c
    turn[0, 0], turn[0, 1], turn[0, 2] = c + v * x * x, v * x * y - s * z, v * x * z + s * y
    turn[1, 0], turn[1, 1], turn[1, 2] = v * x * y + s * z, c + v * y * y, v * y * z - s * x
    turn[2, 0], turn[2, 1], turn[2, 2] = v * x * z - s * y, v * y * z + s * x, c + v * z * z
    turn[3, 3] = 1.0
    _product(T, turn, out)


@njit(cache=True, nogil=True)
def _product(A: np.ndarray, B: np.ndarray, out: np.ndarray) -> None:
    for r in range(4):
        for c in range(4):
            total = 0.0
            for k in range(4):
                total += A[r, k] * B[k, c]
            out[r, c] = total
