"""The cloud check: which grasps keep the hand clear of the observed points and of the table.

Execution refuses a grasp whose open hand runs into an object on its way. A network that predicts
hundreds of grasps offers others instead. The check needs no model of the objects: a hand that has
observed points inside would collide. It cannot notice surfaces that no camera saw.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dmfc.config.execution import ExecutionConfig
from dmfc.geometry.grid_atlas import GridAtlas
from dmfc.hand.approach import Approach
from dmfc.hand.model import HandModel
from dmfc.hand.pose_kernel import link_poses
from dmfc.prediction.cloud_kernel import deepest_points, lowest_points


@dataclass(frozen=True)
class Depths:
    """How deep hands [n] are in what was seen on the way that planning checks, metres.

    What is beyond a tolerance is not looked at to the end: it is at least so deep.
    """

    approach: np.ndarray
    """[n] points in the open hand, from the pre-grasp to the grasp; -1: none."""
    grasp: np.ndarray
    """[n] points in the closed hand at the grasp; -1: none."""
    table: np.ndarray
    """[n] the open or closed hand in the table; below 0: above it."""


class CloudCheck:
    """The poses that planning checks, against points in place of meshes."""

    def __init__(self, hand: HandModel, config: ExecutionConfig) -> None:
        self.hand, self.approach = hand, Approach.of_execution(config)
        grids = GridAtlas(hand.link_grids)
        boxes = np.array([grid.solid_box() for grid in hand.link_grids])
        self._grids = (
            boxes[:, 0],
            boxes[:, 1],
            grids.values.numpy(),
            grids.first.numpy(),
            grids.size.numpy(),
            grids.origin.numpy(),
            grids.spacing.numpy(),
        )

    def clear(
        self,
        T_world_palm: np.ndarray,
        joints: np.ndarray,
        points: np.ndarray,
        margin: float = 0.0,
    ) -> np.ndarray:
        """[n] bool of grasps [n, 4, 4], [n, D] rad.

        `points` [N, 3] are seen on objects, world frame, on a table at z = 0.

        The open hand, from the pre-grasp to the grasp, may be `approach_tolerance` deep in the
        table, and have points that deep inside; the closed one, too, but for the points, which may
        be `grasp_tolerance` deep, since contact stops the fingers. Both less `margin`, metres.
        """
        return self.passes(self.depths(T_world_palm, joints, points), margin)

    def passes(self, depths: Depths, margin: float = 0.0) -> np.ndarray:
        """[n] bool: no deeper than the tolerances less `margin`, metres."""
        allowed = self.approach.stricter(margin)
        return (
            (depths.table <= allowed.table_tolerance)
            & (depths.approach <= max(allowed.tolerance, 0.0))
            & (depths.grasp <= max(allowed.grasp_tolerance, 0.0))
        )

    def depths(self, T_world_palm: np.ndarray, joints: np.ndarray, points: np.ndarray) -> Depths:
        """Of grasps [n, 4, 4], [n, D] rad, among points [N, 3]; the table is at z = 0."""
        approach, hand = self.approach, self.hand
        joints = np.clip(np.asarray(joints, dtype=np.float64), hand.lower, hand.upper)
        opened, closed = link_poses(hand, hand.opened(joints)), link_poses(hand, joints)
        T = np.asarray(T_world_palm, dtype=np.float64)
        back = approach.pregrasp_distance * hand.palm_normal
        table = np.maximum(self._in_table(T, opened, back), self._in_table(T, closed, 0 * back))
        on_way, at_grasp = np.full(len(T), -1.0), np.full(len(T), -1.0)
        rows = np.flatnonzero(table <= approach.table_tolerance)
        self._in_hand(points, T, opened, approach.offsets, approach.tolerance, rows, on_way)
        rows = rows[on_way[rows] <= approach.tolerance]
        self._in_hand(points, T, closed, np.zeros(1), approach.grasp_tolerance, rows, at_grasp)
        return Depths(on_way, at_grasp, table)

    def _in_hand(
        self,
        points: np.ndarray,
        T: np.ndarray,
        links: np.ndarray,
        offsets: np.ndarray,
        enough: float,
        rows: np.ndarray,
        out: np.ndarray,
    ) -> None:
        """Fill out [n] at `rows` with the deepest point in hands at `offsets` from the grasp."""
        deepest, normal = np.empty(len(rows)), self.hand.palm_normal
        cloud = np.ascontiguousarray(points, dtype=np.float64)
        R, t = np.ascontiguousarray(T[rows, :3, :3]), np.ascontiguousarray(T[rows, :3, 3])
        deepest_points(cloud, R, t, links[rows], normal, offsets, *self._grids, enough, deepest)
        out[rows] = deepest

    def _in_table(self, T: np.ndarray, links: np.ndarray, back: np.ndarray) -> np.ndarray:
        """[n] how deep the hand is below z = 0, at the grasp or where it is less `back` [3]."""
        up, lowest = np.ascontiguousarray(T[:, 2, :3]), np.empty(len(T))
        height = T[:, 2, 3] - np.maximum(up @ back, 0.0)
        hand = self.hand
        lowest_points(up, height, links, hand.collision_link, hand.collision_points, lowest)
        return -lowest
