"""Collision: squared penetration of the hand's collision points into everything around them.

collision_i = 1 / (P L) sum_meshes sum_points max(d, 0)^2, d the signed distance, positive inside.
Meshes: the table, each object of the scene, each link of the hand: L = 1 + objects + links.
"""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from dmfc.geometry.box_kernel import points_in_boxes
from dmfc.geometry.grid_atlas import GridAtlas
from dmfc.hand.model import HandModel
from dmfc.objects.atlas import SceneObjects

ROWS = 64
"""Grasps whose self-collision is looked for together; bounds its memory."""


def collision(
    points: Tensor,
    objects: SceneObjects,
    T_world_link: Tensor | None = None,
    self_collision: SelfCollision | None = None,
) -> Tensor:
    """The collision loss of each grasp, [n] m^2.

    points: [n, P, 3] the hand's collision points in the world, on a table whose surface is z = 0.
    With T_world_link [n, L, 4, 4] and `self_collision`, the hand's own links count as meshes too.
    """
    total = table_penetration(points) + object_penetration(points, objects)
    meshes = 1 + objects.count.to(points.dtype)
    if self_collision is not None and T_world_link is not None:
        total = total + self_collision.penetration(points, T_world_link)
        meshes = meshes + self_collision.links
    return total / (points.shape[1] * meshes)


def table_penetration(points: Tensor) -> Tensor:
    """Sum over points [n, P, 3] of max(-z, 0)^2, [n]."""
    return (-points[..., 2]).clamp(min=0).square().sum(-1)


def object_penetration(points: Tensor, objects: SceneObjects) -> Tensor:
    """Sum over points [n, P, 3] and objects of max(d, 0)^2, [n]."""
    return objects.depth(points).square().sum((1, 2))


class SelfCollision:
    """Penetration of a hand's collision points into its links that are not adjacent to theirs."""

    def __init__(self, hand: HandModel) -> None:
        self.links = hand.links
        self.grids = GridAtlas(hand.link_grids)
        boxes = np.array([grid.solid_box() for grid in hand.link_grids])
        self.lower, self.upper = torch.from_numpy(boxes[:, 0]), torch.from_numpy(boxes[:, 1])
        self.link = torch.from_numpy(hand.collision_link)
        self.excluded = torch.from_numpy(hand.adjacency)

    def penetration(self, points: Tensor, T_x_link: Tensor) -> Tensor:
        """Sum over points and links of max(d, 0)^2, [n] m^2.

        points: [n, P, 3] all collision points of the hand, T_x_link: [n, L, 4, 4], in one frame x.
        """
        grasp, link, point = self._near(points.detach(), T_x_link.detach())
        pose = T_x_link[grasp, link]
        offset = points[grasp, point] - pose[:, :3, 3]
        local = (pose[:, :3, :3].mT @ offset[..., None])[..., 0]
        depth = self.grids.lookup(local, link).clamp(min=0)
        return points.new_zeros(len(points)).index_add(0, grasp, depth.square())

    def _near(self, points: Tensor, T_x_link: Tensor) -> tuple[Tensor, ...]:
        """(grasp, link, point) of every point in the box of a link that it may collide with."""
        if points.device.type == "cpu":
            return self._near_compiled(points, T_x_link)
        found, rows = [], zip(points.split(ROWS), T_x_link.split(ROWS), strict=True)
        for i, piece in enumerate(rows):
            grasp, link, point = self._inside(*piece).nonzero(as_tuple=True)
            found.append(torch.stack([grasp + i * ROWS, link, point]))
        return torch.cat(found, dim=1).unbind()

    def _near_compiled(self, points: Tensor, T_x_link: Tensor) -> tuple[Tensor, ...]:
        found = points_in_boxes(
            points.contiguous().numpy(),
            T_x_link[..., :3, :3].contiguous().numpy(),
            T_x_link[..., :3, 3].contiguous().numpy(),
            self.lower.numpy(),
            self.upper.numpy(),
            self.link.numpy(),
            self.excluded.numpy(),
        )
        return torch.from_numpy(found).T.unbind()

    def _inside(self, points: Tensor, T_x_link: Tensor) -> Tensor:
        """[n, L, P] whether a point may collide with a link: in its box and not excluded."""
        local = (points[:, None] - T_x_link[..., None, :3, 3]) @ T_x_link[..., :3, :3]
        lower, upper = self.lower.to(local)[:, None], self.upper.to(local)[:, None]
        excluded = self.excluded.to(local.device)[:, self.link.to(local.device)]
        return ((local >= lower) & (local <= upper)).all(-1) & ~excluded
