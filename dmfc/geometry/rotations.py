"""Rotations as batched tensors: 6-D representation, quaternions (wxyz), angles, random draws.

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


def matrix_from_quaternion(quaternion: Tensor) -> Tensor:
    """Quaternion wxyz [..., 4] (any non-zero length) -> rotation matrix [..., 3, 3]."""
    w, x, y, z = normalize(quaternion, dim=-1).unbind(-1)
    entries = [
        *(1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        *(2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        *(2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    ]
    return torch.stack(entries, dim=-1).unflatten(-1, (3, 3))


def quaternion_from_matrix(rotation: Tensor) -> Tensor:
    """Rotation matrix [..., 3, 3] -> unit quaternion wxyz [..., 4] with w >= 0.

    Of the four rows of 4 q qᵀ (Bar-Itzhack 2000) the one with the largest diagonal entry is
    normalised: no division by a small number, whatever the angle.
    """
    m = rotation
    xx, yy, zz = m[..., 0, 0], m[..., 1, 1], m[..., 2, 2]
    wx, wy, wz = (
        m[..., 2, 1] - m[..., 1, 2],
        m[..., 0, 2] - m[..., 2, 0],
        m[..., 1, 0] - m[..., 0, 1],
    )
    xy, xz, yz = (
        m[..., 0, 1] + m[..., 1, 0],
        m[..., 0, 2] + m[..., 2, 0],
        m[..., 1, 2] + m[..., 2, 1],
    )
    rows = torch.stack(
        [
            torch.stack([1 + xx + yy + zz, wx, wy, wz], dim=-1),
            torch.stack([wx, 1 + xx - yy - zz, xy, xz], dim=-1),
            torch.stack([wy, xy, 1 - xx + yy - zz, yz], dim=-1),
            torch.stack([wz, xz, yz, 1 - xx - yy + zz], dim=-1),
        ],
        dim=-2,
    )
    best = rows.diagonal(dim1=-2, dim2=-1).argmax(-1)
    index = best[..., None, None].expand(*best.shape, 1, 4)
    quaternion = normalize(rows.gather(-2, index).squeeze(-2), dim=-1)
    return torch.where(quaternion[..., :1] < 0, -quaternion, quaternion)


def random_rotations(
    count: int, generator: torch.Generator | None = None, dtype: torch.dtype = torch.float32
) -> Tensor:
    """Rotations uniform on SO(3), [count, 3, 3]: normalised Gaussian quaternions."""
    return matrix_from_quaternion(torch.randn(count, 4, generator=generator, dtype=dtype))
