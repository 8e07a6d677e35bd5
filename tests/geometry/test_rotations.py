"""Rotations and transforms against SciPy."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from dmfc.geometry import transforms
from dmfc.geometry.rotations import (
    geodesic_angle,
    matrix_from_6d,
    sixd_from_matrix,
)
from tests.support.rotations import random_rotations


def generator(seed: int = 0) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


def test_6d_round_trip_and_gram_schmidt() -> None:
    matrices = random_rotations(100, generator(), torch.float64)
    sixd = sixd_from_matrix(matrices)
    assert torch.equal(sixd[:, :3], matrices[:, :, 0])
    assert torch.equal(sixd[:, 3:], matrices[:, :, 1])
    # Any lengths, and any share of a in b, give the same rotation.
    a, b = 3 * sixd[:, :3], 0.2 * sixd[:, 3:] + 5 * sixd[:, :3]
    assert torch.allclose(matrix_from_6d(a, b), matrices, atol=1e-12)


def test_6d_gradient() -> None:
    a, b = torch.randn(2, 4, 3, dtype=torch.float64, generator=generator())
    assert torch.autograd.gradcheck(
        matrix_from_6d, (a.requires_grad_(True), b.requires_grad_(True))
    )


@pytest.mark.parametrize("angle", [0.0, 1e-7, 0.3, 1.5, 3.0, np.pi - 1e-7, np.pi])
def test_geodesic_angle_keeps_its_precision(angle: float) -> None:
    base = random_rotations(50, generator(2), torch.float64)
    axes = torch.randn(50, 3, generator=generator(3), dtype=torch.float64)
    turn = Rotation.from_rotvec(angle * (axes / axes.norm(dim=1, keepdim=True)).numpy())
    measured = geodesic_angle(base, base @ torch.tensor(turn.as_matrix()))
    assert (measured - angle).abs().max() < 1e-12


def test_transforms_in_numpy_and_torch() -> None:
    rotation = random_rotations(6, generator(4), torch.float64)
    position = torch.randn(6, 3, generator=generator(5), dtype=torch.float64)
    points = torch.randn(6, 10, 3, generator=generator(6), dtype=torch.float64)
    T = transforms.transform(rotation, position)
    expected = (rotation[:, None] @ points[..., None])[..., 0] + position[:, None]
    assert torch.allclose(transforms.apply(T, points), expected, atol=1e-12)
    assert torch.allclose(transforms.apply(transforms.inverse(T), expected), points, atol=1e-12)
    assert torch.allclose(transforms.rotate(T, points), expected - position[:, None], atol=1e-12)
    in_numpy = transforms.transform(rotation.numpy(), position.numpy())
    assert np.allclose(in_numpy, T.numpy())
    assert np.allclose(transforms.inverse(in_numpy), np.linalg.inv(in_numpy))
    assert np.allclose(transforms.apply(in_numpy, points.numpy()), expected.numpy())
