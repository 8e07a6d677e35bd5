"""Rotations as batched tensors: the 6-D representation, and angles between them.

A rotation matrix R_a_b [..., 3, 3] maps vectors of frame b into frame a; its columns are b's axes.
"""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn.functional import normalize


def matrix_from_6d(a: Tensor, b: Tensor) -> Tensor:
    """Gram-Schmidt: x = a/|a|, y = normalise(b - (x.b) x), z = x × y (Zhou et al. 2019).

    a, b: [..., 3]. Returns [..., 3, 3] with columns x, y, z; a proper rotation unless a and b are
    parallel or zero.
    """
    x = normalize(a, dim=-1)
    y = normalize(b - (x * b).sum(-1, keepdim=True) * x, dim=-1)
    return torch.stack([x, y, torch.linalg.cross(x, y, dim=-1)], dim=-1)


def sixd_from_matrix(rotation: Tensor) -> Tensor:
    """The first two columns one after the other: [..., 3, 3] -> [..., 6] as (a, b)."""
    return torch.cat([rotation[..., :, 0], rotation[..., :, 1]], dim=-1)


def geodesic_angle(first: Tensor, second: Tensor) -> Tensor:
    """Angle of the rotation between two rotations, rad in [0, pi]: [..., 3, 3] x 2 -> [...].

    atan2 of sine and cosine, which keeps its precision at 0 and at pi, where acos loses half.
    """
    relative = first.transpose(-1, -2) @ second
    cosine = (relative.diagonal(dim1=-2, dim2=-1).sum(-1) - 1) / 2
    skew = (relative - relative.transpose(-1, -2)) / 2
    sine = torch.stack([skew[..., 2, 1], skew[..., 0, 2], skew[..., 1, 0]], dim=-1).norm(dim=-1)
    return torch.atan2(sine, cosine)


def axis_angle_matrix(vector: Tensor) -> Tensor:
    """Rotation by |v| rad about v, [..., 3] -> [..., 3, 3]; differentiable at 0, too."""
    x, y, z = vector.unbind(-1)
    skew = torch.stack(
        [
            torch.stack([0 * x, -z, y], dim=-1),
            torch.stack([z, 0 * x, -x], dim=-1),
            torch.stack([-y, x, 0 * x], dim=-1),
        ],
        dim=-2,
    )
    return torch.linalg.matrix_exp(skew)


def rotation_vector(rotation: Tensor) -> Tensor:
    """Axis times angle in rad of rotations below pi, [..., 3, 3] -> [..., 3]."""
    skew = (rotation - rotation.transpose(-1, -2)) / 2
    axis = torch.stack([skew[..., 2, 1], skew[..., 0, 2], skew[..., 1, 0]], dim=-1)
    sine = axis.norm(dim=-1, keepdim=True)
    cosine = (rotation.diagonal(dim1=-2, dim2=-1).sum(-1, keepdim=True) - 1) / 2
    small = torch.finfo(rotation.dtype).eps
    return axis * torch.where(sine > small, torch.atan2(sine, cosine) / sine.clamp(min=small), 1.0)
