"""`Approach`: how a hand comes to a grasp, and how deep it may be in its surroundings on the way.

The open hand moves straight along its palm normal, from the pre-grasp to the grasp; there the
fingers close. The planner of labels, the labels of a scene, the cloud check and execution all check
this motion. They differ in their settings, which have the same names in each group, and in how they
measure depth: against an object's distance grid, a table and neighbours, observed points, or meshes
in MuJoCo.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from dmfc.config.execution import ExecutionConfig
from dmfc.config.grasps import GraspsConfig
from dmfc.config.scenes import ScenesConfig
from dmfc.hand.model import HandModel


@dataclass(frozen=True)
class Stop:
    """One pose of the hand that is checked, and the penetration that is allowed there, metres."""

    T_palm: np.ndarray
    """[4, 4] in the frame of the grasp."""
    joints: np.ndarray
    """[D] rad."""
    tolerance: float
    """Into objects that are not grasped."""
    target_tolerance: float
    """Into the object that is grasped."""
    table_tolerance: float


@dataclass(frozen=True)
class Approach:
    """The poses and tolerances of the way to a grasp, metres. Depths are positive inside.

    The fingers are open by `closing.opening` on the way (`HandModel.opened`).
    """

    pregrasp_distance: float
    """From the pre-grasp to the grasp, along the palm normal."""
    waypoints: int
    """Poses of the open hand that are checked, pre-grasp and grasp included; 1: the grasp alone."""
    tolerance: float
    """Depth of the open hand in an object, and of the closed hand in one that is not grasped."""
    grasp_tolerance: float
    """Depth of the closed hand in the object that is grasped, where contact stops the fingers."""
    table_tolerance: float
    """Depth of the open or closed hand in the table."""

    @classmethod
    def of_planner(cls, config: GraspsConfig) -> Approach:
        """To an object alone. The table counts at the grasp; simulation judges the closed hand."""
        distance, depth = config.pregrasp_distance, config.approach_tolerance
        return cls(distance, config.waypoints, depth, np.inf, 0.0)

    @classmethod
    def of_labels(cls, config: ScenesConfig) -> Approach:
        """Of a label among neighbours: at the grasp alone, since the planner checked the way."""
        depth = config.approach_tolerance
        return cls(0.0, 1, depth, np.inf, depth)

    @classmethod
    def of_execution(cls, config: ExecutionConfig) -> Approach:
        """Of a grasp that is executed, and of the cloud check, which foresees that."""
        distance, depth = config.pregrasp_distance, config.approach_tolerance
        return cls(distance, config.waypoints, depth, config.grasp_tolerance, depth)

    @property
    def offsets(self) -> np.ndarray:
        """[W] distances from the grasp, back along the palm normal; the grasp (0) first."""
        return np.linspace(0.0, self.pregrasp_distance, self.waypoints)

    def stricter(self, margin: float) -> Approach:
        """The same way with every tolerance less `margin`, metres."""
        return replace(
            self,
            tolerance=self.tolerance - margin,
            grasp_tolerance=self.grasp_tolerance - margin,
            table_tolerance=self.table_tolerance - margin,
        )

    def pregrasp(self, T_palm: np.ndarray, hand: HandModel) -> np.ndarray:
        """[4, 4] palm at the pre-grasp of a grasp [4, 4], in any frame."""
        T = T_palm.copy()
        T[:3, 3] += -self.pregrasp_distance * (T_palm[:3, :3] @ hand.palm_normal)
        return T

    def stops(self, T_palm: np.ndarray, joints: np.ndarray, hand: HandModel) -> Iterator[Stop]:
        """The poses on the way to a grasp [4, 4], [D] rad: open from the pre-grasp, then closed."""
        start, opened = self.pregrasp(T_palm, hand), hand.opened(joints)
        for share in np.linspace(1.0, 0.0, self.waypoints)[::-1]:
            T = T_palm.copy()
            T[:3, 3] = start[:3, 3] + share * (T_palm[:3, 3] - start[:3, 3])
            yield Stop(T, opened, self.tolerance, self.tolerance, self.table_tolerance)
        yield Stop(T_palm, joints, self.tolerance, self.grasp_tolerance, self.table_tolerance)
