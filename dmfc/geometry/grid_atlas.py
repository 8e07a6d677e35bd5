"""`GridAtlas`: many distance grids in one tensor, looked up together and differentiably.

Same values as `Grid.distance`. On the CPU a compiled loop, elsewhere tensor operations.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.autograd.function import once_differentiable

from dmfc.geometry.grid import Grid
from dmfc.geometry.grid_kernel import distance_and_gradient

FAR = -10.0
"""Signed distance to a grid that is not there, metres."""
CHUNK = 2_000_000
"""Lookups that the tensor path does at a time: bounds its temporary memory."""


class GridAtlas:
    """G grids. Holds one copy of their values per device it was used on."""

    def __init__(self, grids: Sequence[Grid]) -> None:
        """Raises ValueError without a grid."""
        if not grids:
            raise ValueError("an atlas needs a grid")
        sizes = [grid.values.size for grid in grids]
        self.values = torch.from_numpy(np.concatenate([grid.values.reshape(-1) for grid in grids]))
        self.first = torch.from_numpy(np.cumsum([0, *sizes[:-1]]))
        self.size = torch.tensor([grid.values.shape for grid in grids])
        self.origin = torch.from_numpy(np.stack([grid.origin for grid in grids]))
        self.spacing = torch.tensor([grid.spacing for grid in grids], dtype=torch.float64)
        self._copies: dict[torch.device, dict[str, Tensor]] = {}

    def __len__(self) -> int:
        return len(self.first)

    def distance(
        self, points: Tensor, grid: Tensor, T_x_grid: Tensor, near: bool = False
    ) -> Tensor:
        """Signed distance of points [n, P, 3] in frame x to K grids each, [n, K, P] metres.

        grid: [n, K] index into the atlas, negative where there is none (the distance is `FAR`).
        T_x_grid: [n, K, 4, 4], which gets no gradient. The gradient of the points is exact except
        on the faces of voxels, where it jumps; there is no second derivative.
        near: only penetration is asked for. Beyond the box of a grid, where there is none, the
        distance may be anything negative, and its gradient 0.
        """
        result: Tensor = _Distance.apply(points, grid, T_x_grid.detach(), self, near)
        return result

    def lookup(self, points: Tensor, grid: Tensor) -> Tensor:
        """Signed distance of points [n, 3] in the frame of grid [n] each, [n]."""
        T = torch.eye(4, dtype=points.dtype, device=points.device).expand(len(points), 1, 4, 4)
        return self.distance(points[:, None], grid[:, None], T)[:, 0, 0]

    def on(self, device: torch.device) -> dict[str, Tensor]:
        """The atlas' tensors on a device."""
        if device not in self._copies:
            names = ("values", "first", "size", "origin", "spacing")
            self._copies[device] = {name: getattr(self, name).to(device) for name in names}
        return self._copies[device]


class _Distance(torch.autograd.Function):
    @staticmethod
    def forward(
        ctx: Any, points: Tensor, grid: Tensor, T_x_grid: Tensor, atlas: GridAtlas, near: bool
    ) -> Tensor:
        wanted = ctx.needs_input_grad[0]
        pose = T_x_grid.to(points.dtype)
        if points.device.type == "cpu":
            distance, gradient = _on_cpu(points.detach(), grid, pose, atlas, wanted, near)
        else:
            distance, gradient = _by_tensors(points.detach(), grid, pose, atlas, wanted)
        if wanted:
            ctx.save_for_backward(gradient)
        return distance

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, grad_distance: Tensor) -> tuple[Tensor | None, None, None, None, None]:
        (gradient,) = ctx.saved_tensors
        return (grad_distance[..., None] * gradient).sum(dim=1), None, None, None, None


def _on_cpu(
    points: Tensor,
    grid: Tensor,
    T_x_grid: Tensor,
    atlas: GridAtlas,
    wanted: bool,
    near: bool,
) -> tuple[Tensor, Tensor]:
    """Distance [n, K, P] and, where it is wanted, its gradient [n, K, P, 3]."""
    shape = (*grid.shape, points.shape[1])
    distance = points.new_full(shape, FAR)
    gradient = points.new_zeros((*shape, 3) if wanted else (0, 0, 0, 3))
    constant = atlas.on(points.device)
    distance_and_gradient(
        points.contiguous().numpy(),
        T_x_grid[..., :3, :3].contiguous().numpy(),
        T_x_grid[..., :3, 3].contiguous().numpy(),
        grid.contiguous().numpy(),
        constant["values"].numpy(),
        constant["first"].numpy(),
        constant["size"].numpy(),
        constant["origin"].numpy(),
        constant["spacing"].numpy(),
        near,
        distance.numpy(),
        gradient.numpy(),
    )
    return distance, gradient


def _by_tensors(
    points: Tensor, grid: Tensor, T_x_grid: Tensor, atlas: GridAtlas, wanted: bool
) -> tuple[Tensor, Tensor]:
    """As `_on_cpu`, with every distance."""
    rows = max(CHUNK // max(grid.shape[1] * points.shape[1], 1), 1)
    distances, gradients = [], [points.new_zeros(0, grid.shape[1], points.shape[1], 3)]
    for piece in zip(points.split(rows), grid.split(rows), T_x_grid.split(rows), strict=True):
        distance, gradient = _lookup(*piece, atlas)
        distances.append(distance)
        if wanted:
            gradients.append(gradient)
    return torch.cat(distances), torch.cat(gradients)


def _lookup(
    points: Tensor, grid: Tensor, T_x_grid: Tensor, atlas: GridAtlas
) -> tuple[Tensor, Tensor]:
    """Distance [n, K, P] and its gradient [n, K, P, 3] with respect to the points."""
    constant = atlas.on(points.device)
    present = grid.clamp(min=0)
    origin = constant["origin"][present][:, :, None].to(points.dtype)
    spacing = constant["spacing"][present][..., None, None].to(points.dtype)
    size = constant["size"][present][:, :, None]
    rotation = T_x_grid[..., :3, :3]
    local = (points[:, None] - T_x_grid[..., None, :3, 3]) @ rotation
    node = (local - origin) / spacing
    # A point that is not a number has no cell; its distance becomes NaN through `outside`.
    clamped = torch.minimum(node.nan_to_num().clamp(min=0), (size - 1).to(points.dtype))
    outside = (node - clamped) * spacing
    cell = torch.minimum(clamped.long(), size - 2)
    value, slope = _trilinear(clamped - cell, cell, size, constant, present)
    apart = outside.norm(dim=-1)
    away = -outside / apart.clamp(min=torch.finfo(points.dtype).tiny)[..., None]
    gradient = torch.where(outside == 0, slope / spacing, away) @ rotation.mT
    absent = (grid < 0)[..., None]
    distance = (value - apart).masked_fill(absent, FAR)
    return distance, gradient.masked_fill(absent[..., None], 0.0)


def _trilinear(
    fraction: Tensor, cell: Tensor, size: Tensor, constant: dict[str, Tensor], present: Tensor
) -> tuple[Tensor, Tensor]:
    """Value [n, K, P] and its gradient [n, K, P, 3] per voxel, in cells with given fractions."""
    ny, nz = size[..., 1], size[..., 2]
    corner = constant["first"][present][..., None]
    corner = corner + (cell[..., 0] * ny + cell[..., 1]) * nz + cell[..., 2]
    steps = [(i * ny + j) * nz + k for i in (0, 1) for j in (0, 1) for k in (0, 1)]
    v = torch.stack([constant["values"][corner + step] for step in steps]).to(fraction.dtype)
    fx, fy, fz = fraction.unbind(-1)
    along_x = torch.lerp(v[:4], v[4:], fx)
    along_y = torch.lerp(along_x[:2], along_x[2:], fy)
    by_x = torch.lerp(v[4:6] - v[:2], v[6:] - v[2:4], fy)
    slope_x = torch.lerp(by_x[0], by_x[1], fz)
    slope_y = torch.lerp(along_x[2] - along_x[0], along_x[3] - along_x[1], fz)
    slope = torch.stack([slope_x, slope_y, along_y[1] - along_y[0]], dim=-1)
    return torch.lerp(along_y[0], along_y[1], fz), slope
