"""Which grasps keep the hand clear of what was seen: the cloud, and the table under it.

Execution refuses a grasp whose open hand runs into an object on its way. A network that predicts
hundreds of grasps can be asked for others instead, without a model of the objects: a hand that has
observed points inside it is in the way of something. What the cameras did not see is not noticed.
"""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from dmfc.config.execution import ExecutionConfig
from dmfc.geometry.box_kernel import points_in_boxes
from dmfc.geometry.grid_atlas import GridAtlas
from dmfc.hand.kinematics import HandKinematics
from dmfc.hand.model import HandModel


class CloudCheck:
    """The poses that planning checks, against points in place of meshes."""

    def __init__(self, hand: HandModel, config: ExecutionConfig) -> None:
        self.hand, self.config = hand, config
        self._kinematics = HandKinematics(hand)
        self._grids = GridAtlas(hand.link_grids)
        boxes = np.array([grid.solid_box() for grid in hand.link_grids])
        self._lower, self._upper = boxes[:, 0], boxes[:, 1]

    def clear(self, T_world_palm: np.ndarray, joints: np.ndarray, points: np.ndarray) -> np.ndarray:
        """[n] bool of grasps [n, 4, 4], [n, D] rad.

        `points` [N, 3] are seen on objects, world frame, on a table at z = 0.

        The open hand, from the pre-grasp to the grasp, may be `approach_tolerance` deep in the
        table, and have points that deep inside; the closed one, too, but for the points, which may
        be `grasp_tolerance` deep, since contact stops the fingers.
        """
        config, hand = self.config, self.hand
        cloud = torch.as_tensor(points, dtype=torch.float64)
        T_grasp = torch.as_tensor(T_world_palm, dtype=torch.float64)
        back = T_grasp[:, :3, :3] @ torch.as_tensor(hand.palm_normal) * config.pregrasp_distance
        joints = np.clip(joints, hand.lower, hand.upper)
        closed = self._links(joints)
        clear = self._is_clear(T_grasp[:, None] @ closed, cloud, config.grasp_tolerance)
        opened = self._links(hand.opened(joints))
        for share in np.linspace(1.0, 0.0, config.waypoints):
            T = T_grasp.clone()
            T[:, :3, 3] -= (1.0 - share) * back
            clear &= self._is_clear(T[:, None] @ opened, cloud, config.approach_tolerance)
        return clear

    def _links(self, joints: np.ndarray) -> Tensor:
        return self._kinematics.forward(torch.as_tensor(joints, dtype=torch.float64))

    def _is_clear(self, T_world_link: Tensor, cloud: Tensor, tolerance: float) -> np.ndarray:
        """[n] of hands [n, L, 4, 4] among points [N, 3]."""
        lowest = self._kinematics.collision_points_of_links(T_world_link)[..., 2].amin(1)
        clear = (lowest >= -self.config.approach_tolerance).numpy()
        grasp, link, point = self._near(T_world_link, cloud)
        pose = T_world_link[grasp, link]
        local = (pose[:, :3, :3].mT @ (cloud[point] - pose[:, :3, 3])[..., None])[..., 0]
        deep = self._grids.lookup(local, link) > tolerance
        clear[grasp[deep].numpy()] = False
        return clear

    def _near(self, T_world_link: Tensor, cloud: Tensor) -> tuple[Tensor, ...]:
        """(grasp, link, point) of every point in the box of a link."""
        count, links = T_world_link.shape[:2]
        found = points_in_boxes(
            cloud.expand(count, *cloud.shape).contiguous().numpy(),
            T_world_link[..., :3, :3].contiguous().numpy(),
            T_world_link[..., :3, 3].contiguous().numpy(),
            self._lower,
            self._upper,
            np.zeros(len(cloud), dtype=np.int64),
            np.zeros((links, links), dtype=bool),
        )
        return torch.from_numpy(found).T.unbind()
