"""Homogeneous transforms [..., 4, 4], NumPy or torch: T_a_b maps points of frame b into frame a."""

from __future__ import annotations

from typing import TypeVar

import numpy as np
import torch

Array = TypeVar("Array", np.ndarray, torch.Tensor)


def transform(rotation: Array, position: Array) -> Array:
    """T_a_b [..., 4, 4] from R_a_b [..., 3, 3] and the origin of b in a, [..., 3]."""
    if isinstance(rotation, torch.Tensor):
        position = position[..., None].expand(*rotation.shape[:-1], 1)
        top = torch.cat([rotation, position], dim=-1)
        bottom = torch.zeros_like(top[..., :1, :])
        bottom[..., 3] = 1
        return torch.cat([top, bottom], dim=-2)
    return _transform_numpy(rotation, position)


def inverse(T_a_b: Array) -> Array:
    """T_b_a, by the transpose of the rotation: (Rᵀ, -Rᵀ t)."""
    rotation = T_a_b[..., :3, :3].swapaxes(-1, -2)
    return transform(rotation, -(rotation @ T_a_b[..., :3, 3:])[..., 0])


def apply(T_a_b: Array, points: Array) -> Array:
    """p_a = T_a_b @ p_b for points [..., P, 3] and T_a_b [..., 4, 4] (leading shapes broadcast)."""
    return points @ T_a_b[..., :3, :3].swapaxes(-1, -2) + T_a_b[..., None, :3, 3]


def rotate(T_a_b: Array, vectors: Array) -> Array:
    """v_a = R_a_b @ v_b for free vectors (normals) [..., P, 3]."""
    return vectors @ T_a_b[..., :3, :3].swapaxes(-1, -2)


def _transform_numpy(rotation: np.ndarray, position: np.ndarray) -> np.ndarray:
    shape = np.broadcast_shapes(rotation.shape[:-2], position.shape[:-1])
    result = np.zeros((*shape, 4, 4), dtype=np.result_type(rotation, position))
    result[..., :3, :3], result[..., :3, 3], result[..., 3, 3] = rotation, position, 1
    return result
