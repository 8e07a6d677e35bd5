"""`Grid`: signed distance sampled on a regular grid, positive inside, looked up trilinearly.

NumPy; `dmfc.geometry.grid_lookup` does the same lookup for many grids in torch, differentiably.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Grid:
    """Signed distance (metres, positive inside) at the nodes origin + spacing * (i, j, k)."""

    values: np.ndarray
    """[nx, ny, nz] float32, each size at least 2."""
    origin: np.ndarray
    """[3] float64: the node (0, 0, 0), metres."""
    spacing: float
    """Metres between neighbouring nodes."""

    def __post_init__(self) -> None:
        if self.values.ndim != 3 or min(self.values.shape) < 2:
            raise ValueError(f"a grid needs two nodes along each axis, not {self.values.shape}")
        if not self.spacing > 0:
            raise ValueError(f"grid spacing must be positive, not {self.spacing}")
        object.__setattr__(self, "values", np.ascontiguousarray(self.values, dtype=np.float32))
        object.__setattr__(self, "origin", np.asarray(self.origin, dtype=np.float64))
        object.__setattr__(self, "spacing", float(self.spacing))

    @classmethod
    def sample(
        cls,
        distance: Callable[[np.ndarray], np.ndarray],
        lower: np.ndarray,
        upper: np.ndarray,
        spacing: float,
    ) -> Grid:
        """Sample `distance` ([n, 3] -> [n]) on the nodes that cover the box lower..upper [3]."""
        lower = np.asarray(lower, dtype=np.float64)
        steps = np.ceil((np.asarray(upper) - lower) / spacing - 1e-9)
        shape = np.maximum(steps.astype(int), 1) + 1
        nodes = np.stack(np.meshgrid(*map(np.arange, shape), indexing="ij"), axis=-1).reshape(-1, 3)
        return cls(distance(lower + spacing * nodes).reshape(shape), lower, spacing)

    @property
    def upper(self) -> np.ndarray:
        """[3] the last node; the box of the grid is origin..upper, metres."""
        return self.origin + self.spacing * (np.array(self.values.shape) - 1)

    def solid_box(self) -> tuple[np.ndarray, np.ndarray]:
        """Box [3], [3] of the cells where the distance is positive anywhere; empty if in none."""
        solid = np.argwhere(self.values > 0)
        if len(solid) == 0:
            return np.full(3, np.inf), np.full(3, -np.inf)
        lower = self.origin + self.spacing * (solid.min(axis=0) - 1)
        return lower, self.origin + self.spacing * (solid.max(axis=0) + 1)

    def distance(self, points: np.ndarray) -> np.ndarray:
        """Signed distance at points [..., 3] in the grid's frame -> [...] float64.

        Trilinear in the box. Outside: the value at the nearest point of the box minus the distance
        to the box, so that it is continuous and falls as the true distance does.
        """
        corners, fraction, outside = self._cell(points)
        fx, fy, fz = np.moveaxis(fraction, -1, 0)[..., None, None]
        along_x = corners[..., 0, :, :] * (1 - fx) + corners[..., 1, :, :] * fx
        fy, fz = fy[..., 0], fz[..., 0, 0]
        along_y = along_x[..., 0, :] * (1 - fy) + along_x[..., 1, :] * fy
        value = along_y[..., 0] * (1 - fz) + along_y[..., 1] * fz
        return value - np.linalg.norm(outside, axis=-1)

    def gradient(self, points: np.ndarray) -> np.ndarray:
        """Gradient of `distance` by central differences of half a voxel, [..., 3] -> [..., 3].

        It points inwards; the outward normal of the surface is minus its direction.
        """
        points = np.asarray(points, dtype=np.float64)
        step = np.eye(3) * self.spacing / 2
        shifted = points[..., None, :]
        return (self.distance(shifted + step) - self.distance(shifted - step)) / self.spacing

    def arrays(self, prefix: str) -> dict[str, np.ndarray]:
        """The grid as arrays for `np.savez`, their names beginning with `prefix`."""
        return {
            f"{prefix}_values": self.values,
            f"{prefix}_origin": self.origin,
            f"{prefix}_spacing": np.array(self.spacing),
        }

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, np.ndarray], prefix: str) -> Grid:
        """What `arrays(prefix)` wrote. Raises KeyError if an array is missing."""
        values, origin = arrays[f"{prefix}_values"], arrays[f"{prefix}_origin"]
        return cls(values, origin, float(arrays[f"{prefix}_spacing"]))

    def _cell(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Corner values [..., 2, 2, 2]; place in the cell, offset from the box: [..., 3]."""
        points = np.asarray(points, dtype=np.float64)
        clamped = np.clip(points, self.origin, self.upper)
        nodes = (clamped - self.origin) / self.spacing
        last = np.array(self.values.shape) - 2
        index = np.clip(nodes.astype(np.int64), 0, last)
        _, ny, nz = self.values.shape
        first = (index[..., 0] * ny + index[..., 1]) * nz + index[..., 2]
        steps = np.array([[[0, 1], [nz, nz + 1]], [[0, 1], [nz, nz + 1]]])
        steps[1] += ny * nz
        corners = self.values.reshape(-1)[first[..., None, None, None] + steps]
        return corners.astype(np.float64), nodes - index, points - clamped
