"""Random rotations for tests, by SciPy."""

from __future__ import annotations

import torch
from scipy.spatial.transform import Rotation
from torch import Tensor


def random_rotations(
    count: int, generator: torch.Generator | None = None, dtype: torch.dtype = torch.float32
) -> Tensor:
    """Rotations uniform on SO(3), [count, 3, 3]: Gaussian quaternions, which SciPy normalises."""
    quaternions = torch.randn(count, 4, generator=generator, dtype=dtype)
    matrices = Rotation.from_quat(quaternions.numpy(), scalar_first=True).as_matrix()
    return torch.from_numpy(matrices).to(dtype)
