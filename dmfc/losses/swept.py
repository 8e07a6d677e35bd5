"""Swept collision: squared penetration beyond what execution allows, all the way to a grasp.

swept_i = 1 / (P (W + 1)) sum_poses sum_points max(d - allowed, 0)^2, d the signed distance,
positive inside. Poses: the opened hand at the W waypoints of the approach, then the closed hand at
the grasp. Meshes: the table and each object, and not the hand itself.
"""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from dmfc.config.losses import SweptConfig
from dmfc.geometry.transforms import transform
from dmfc.hand.approach import Approach
from dmfc.hand.kinematics import HandKinematics
from dmfc.objects.atlas import SceneObjects


class SweptCollision:
    """The poses of an approach, and what the loss allows at each.

    It allows what the approach does less the margin; the closed hand in the object that is grasped
    may be `grasp_tolerance` of the loss deep, or that of the approach where it is less.
    """

    def __init__(self, kinematics: HandKinematics, config: SweptConfig, approach: Approach) -> None:
        self.kinematics = kinematics
        self.back = torch.from_numpy(approach.offsets)
        strict = approach.stricter(config.margin)
        self.tolerance, self.table_tolerance = strict.tolerance, strict.table_tolerance
        self.grasp_tolerance = min(config.grasp_tolerance, approach.grasp_tolerance)
        hand = kinematics.hand
        self.opening = torch.from_numpy(hand.closing.opening * np.asarray(hand.flexion))
        self.normal = torch.from_numpy(np.asarray(hand.palm_normal))

    def __call__(
        self, position: Tensor, rotation: Tensor, joints: Tensor, objects: SceneObjects
    ) -> Tensor:
        """[n] m^2 of palms [n, 3], [n, 3, 3] in the world, joints [n, D] rad within the limits."""
        opened = self.kinematics.clamp(joints - self.opening.to(joints))
        palm = transform(rotation, position)
        points = self.kinematics.collision_points(
            torch.cat([palm, palm]), torch.cat([opened, joints])
        )
        open_points, closed_points = points.split(len(joints))
        way = (rotation @ self.normal.to(rotation))[:, None] * -self.back.to(rotation)[:, None]
        swept = (open_points[:, None] + way[:, :, None]).flatten(1, 2)
        total = self._beyond(swept, self._depth(swept, objects), self.tolerance)
        depth = self._depth(closed_points, objects)
        allowed = torch.full_like(depth[..., :1], self.tolerance)
        allowed.scatter_(1, grasped(depth)[:, None, None], self.grasp_tolerance)
        total = total + self._beyond(closed_points, depth, allowed)
        return total / (points.shape[1] * (len(self.back) + 1))

    def _depth(self, points: Tensor, objects: SceneObjects) -> Tensor:
        """[n, K, P]; where a clearance is asked for, of points outside as well."""
        return objects.depth(points) if self.tolerance >= 0 else objects.distance(points)

    def _beyond(self, points: Tensor, depth: Tensor, allowed: Tensor | float) -> Tensor:
        """Sum of the squares beyond what is allowed, in objects and in the table, [n]."""
        table = (-points[..., 2] - self.table_tolerance).clamp(min=0).square().sum(-1)
        return table + (depth - allowed).clamp(min=0).square().sum((1, 2))


def grasped(distance: Tensor) -> Tensor:
    """[n] which of K objects the closed hand holds: the one that its points are deepest in or
    nearest to, by the mean of their signed distances [n, K, P] (those not there are far off)."""
    return distance.detach().clamp(min=-NEAR).mean(-1).argmax(-1)


NEAR = 0.05
"""Metres beyond which a point does not tell which object is held."""
