"""Candidates: palm poses guided by the surface, backed off until free, fingers closed on it.

No simulation here: signed distances of points on the hand decide where a hand fits and where each
finger meets the object, for a whole batch at once. What looks like a grasp goes to the check.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from dmfc.config.grasps import GraspsConfig
from dmfc.grasps import hand_kernel
from dmfc.grasps.grasps import Grasps
from dmfc.grasps.hand_arrays import grid_arrays, hand_arrays
from dmfc.hand.approach import Approach
from dmfc.hand.description import HandDescription
from dmfc.hand.fingers import finger_axis, fingers
from dmfc.hand.model import HandModel
from dmfc.objects.model import ObjectModel


@dataclass(frozen=True)
class Candidates(Grasps):
    """B hands in the object's frame, each finger closed until it touches.

    A finger that never does stays open.
    """

    preshape: np.ndarray
    """[B, D] rad, before the fingers close; free of the object."""
    touching: np.ndarray
    """[B, F] bool, fingers that touch."""
    stable_pose: np.ndarray
    """[B] stable pose of the object in which the hand keeps off the table; -1: not asked for."""


class Proposer:
    """Draws candidates for one object and one hand."""

    def __init__(
        self,
        model: ObjectModel,
        hand: HandModel,
        description: HandDescription,
        config: GraspsConfig,
    ) -> None:
        self.description = description
        self.model, self.hand, self.config = model, hand, config
        self.finger_of_dof, self.finger_of_link = fingers(hand)
        self._hand = hand_arrays(hand, self.finger_of_link)
        self._grid = grid_arrays(model.sdf)
        self._axis = finger_axis(hand)

    def draw(self, count: int, generator: np.random.Generator) -> Candidates:
        """At most `count` candidates: those that fit and that at least two fingers close on."""
        pose = self._stable_poses(count, generator)
        position, rotation = self._palms(self._supports(pose), generator)
        preshape = self._preshapes(count, generator)
        config = self.config
        steps = np.arange(0.0, config.back_off + 1e-9, config.back_off_step)
        found = self._back_off(position, rotation, preshape, pose, steps)
        found = self._close(found)
        found = found[found.touching.sum(axis=1) >= 2]
        return found[
            self.reachable(found.position, found.rotation, found.joints, found.stable_pose)
        ]

    def draw_open(self, count: int, generator: np.random.Generator) -> Candidates:
        """At most `count` open hands that look straight at a surface point, at any roll.

        Those that are free of the object and of which at least two fingers would close on it. They
        are not centred and not backed off: a thumb that is beside the object gets around it.
        """
        model, hand = self.model, self.hand
        rows = generator.integers(len(model.surface_points), size=count)
        approach = -model.surface_normals[rows].astype(np.float64)
        fingers_to = np.cross(approach, generator.normal(size=(count, 3)))
        fingers_to /= np.linalg.norm(fingers_to, axis=1, keepdims=True)
        rotation = _frames(approach, fingers_to) @ _frames(hand.palm_normal, self._axis).T
        at = (
            model.surface_points[rows] - _between(self.config.seat_gap, count, generator) * approach
        )
        position = at - rotation @ hand.palm_reference
        opened = np.repeat(hand.open_joints[None].astype(np.float64), count, axis=0)
        anywhere = np.full(count, -1)
        found = self._close(self._back_off(position, rotation, opened, anywhere, np.zeros(1)))
        return found[found.touching.sum(axis=1) >= 2]

    def reached(self, T_object_palm: np.ndarray, joints: np.ndarray) -> np.ndarray:
        """The stable poses of the object in which the hand [4, 4], [D] is `reachable`."""
        poses = np.arange(len(self.model.stable_heights))
        palm, joints = (np.repeat(a[None], len(poses), axis=0) for a in (T_object_palm, joints))
        return poses[self.reachable(palm[:, :3, 3], palm[:, :3, :3], joints, poses)]

    def _stable_poses(self, count: int, generator: np.random.Generator) -> np.ndarray:
        """[count] poses of the object, by their probability, or -1 for a share without a table."""
        probabilities = self.model.stable_probabilities
        poses = generator.choice(len(probabilities), size=count, p=probabilities)
        return np.where(generator.uniform(size=count) < self.config.table_share, poses, -1)

    def _supports(self, pose: np.ndarray) -> np.ndarray:
        """[B, 4] planes a, b: height above the table = a . p + b; 0 0 0 1 where there is none."""
        model = self.model
        planes = np.concatenate(
            [model.stable_rotations[pose, 2], model.stable_heights[pose, None]], axis=1
        )
        planes[pose < 0] = [0.0, 0.0, 0.0, 1.0]
        return planes

    def _palms(
        self, support: np.ndarray, generator: np.random.Generator
    ) -> tuple[np.ndarray, np.ndarray]:
        """Palm poses that look at a random surface point along about its inward normal."""
        config, hand, count = self.config, self.hand, len(support)
        rows = self._targets(support, generator)
        target = self.model.surface_points[rows].astype(np.float64)
        tilt = generator.normal(0.0, config.approach_tilt, (count, 3))
        approach = -self.model.surface_normals[rows].astype(np.float64) + tilt
        approach /= np.linalg.norm(approach, axis=1, keepdims=True)
        fingers_to, middle = self._straddle(target, approach, generator)
        axis = self._axis
        rotation = _frames(approach, fingers_to) @ _frames(hand.palm_normal, axis).T
        # What is held lies somewhere between the palm's centre and the roots of the fingers.
        ahead = _between(config.palm_shift, count, generator) * axis
        reference = hand.palm_reference + ahead
        gap = _between(config.palm_gap, count, generator)
        at = target + middle * fingers_to - gap * approach
        return at - np.einsum("bij,bj->bi", rotation, reference), rotation

    def _straddle(
        self, target: np.ndarray, approach: np.ndarray, generator: np.random.Generator
    ) -> tuple[np.ndarray, np.ndarray]:
        """Directions of the fingers [B, 3], and how far the object's middle is along them [B, 1].

        Of a few random rolls the one is taken across which the object is narrowest, and the hand is
        centred on that width, so that thumb and fingers come down on both sides; a share of the
        candidates is left as it falls.
        """
        config, count = self.config, len(target)
        rolls = np.cross(approach, generator.normal(size=(config.rolls, count, 3)))
        rolls /= np.linalg.norm(rolls, axis=2, keepdims=True)
        sample = generator.choice(len(self.model.surface_points), size=256)
        points = self.model.surface_points[sample].astype(np.float64)
        low, high = hand_kernel.widths(points, target, approach, rolls, config.finger_reach, 0.02)
        met = high >= low
        width = np.subtract(high, low, out=np.full_like(low, np.inf), where=met)
        best = np.argmin(width, axis=0)
        as_it_falls = generator.uniform(size=count) >= config.straddle_share
        best[as_it_falls] = 0
        row = np.arange(count)
        centred = ~as_it_falls & np.isfinite(width[best, row])
        middle = np.zeros(count)
        middle[centred] = 0.5 * (low[best, row][centred] + high[best, row][centred])
        return rolls[best, row], middle[:, None]

    def _targets(self, support: np.ndarray, generator: np.random.Generator) -> np.ndarray:
        """[B] surface points that do not look down on the table."""
        normals = self.model.surface_normals
        rows = generator.integers(len(normals), size=(8, len(support)))
        down = np.einsum("kbi,bi->kb", normals[rows], support[:, :3]) < -0.3
        return rows[np.argmin(down, axis=0), np.arange(len(support))]

    def reachable(
        self,
        position: np.ndarray,
        rotation: np.ndarray,
        joints: np.ndarray,
        stable_pose: np.ndarray,
    ) -> np.ndarray:
        """[B] whether the hand keeps off the table, and gets there open without hitting the object.

        It comes by `Approach.of_planner`.
        Palms [B, 3] and [B, 3, 3], joints [B, D], stable poses [B] (-1: no table).
        """
        approach, planes = Approach.of_planner(self.config), self._supports(stable_pose)
        planes[:, 3] += approach.table_tolerance
        return hand_kernel.reachable(
            self._hand,
            self._grid,
            rotation,
            position,
            self.hand.opened(joints),
            joints,
            self._back(rotation),
            planes,
            approach.offsets,
            approach.tolerance,
        )

    def _back(self, rotation: np.ndarray) -> np.ndarray:
        """[B, 3] away from the object along the palm normal."""
        return -np.einsum("bij,j->bi", rotation, self.hand.palm_normal)

    def _preshapes(self, count: int, generator: np.random.Generator) -> np.ndarray:
        """Open hands drawn from the description's ranges.

        Joints that close the hand and have the same range, such as the knuckles of all fingers, are
        flexed about alike.
        """
        ranges = self.description.preshape_range
        _, kind = np.unique(ranges, axis=0, return_inverse=True)
        alike = generator.uniform(size=(count, kind.max() + 1))[:, kind.ravel()]
        single = generator.uniform(size=(count, len(ranges)))
        mixed = np.where(self.hand.flexion != 0, 0.7 * alike + 0.3 * single, single)
        lower, upper = ranges.T
        return np.clip(lower + mixed * (upper - lower), self.hand.lower, self.hand.upper)

    def _back_off(
        self,
        position: np.ndarray,
        rotation: np.ndarray,
        preshape: np.ndarray,
        pose: np.ndarray,
        steps: np.ndarray,
    ) -> Candidates:
        """Each hand at the first of the steps back along its palm normal, metres, where it is free.

        Those that are free at none go.
        """
        config, back = self.config, self._back(rotation)
        shift = hand_kernel.back_off(
            self._hand,
            self._grid,
            rotation,
            position,
            preshape,
            back,
            self._supports(pose),
            steps,
            config.clearance,
        )
        free = np.isfinite(shift)
        return Candidates(
            (position + shift[:, None] * back)[free],
            rotation[free],
            preshape[free],
            preshape[free],
            np.zeros((int(free.sum()), self.finger_of_dof.max() + 1), dtype=bool),
            pose[free],
        )

    def _close(self, candidates: Candidates) -> Candidates:
        """Close every finger from the pre-shape until it touches.

        A finger that never touches stays as it was.
        """
        config, hand, preshape = self.config, self.hand, candidates.preshape
        touching = np.zeros_like(candidates.touching)
        closed = np.zeros(touching.shape)
        hand_kernel.close(
            self._hand,
            self._grid,
            candidates.rotation,
            candidates.position,
            preshape,
            config.close_range / config.close_steps,
            config.close_steps,
            closed,
            touching,
        )
        amount = np.where(self.finger_of_dof >= 0, closed[:, self.finger_of_dof], 0.0)
        joints = np.clip(preshape + amount * hand.flexion, hand.lower, hand.upper)
        return replace(candidates, joints=joints, touching=touching)


def _between(limits: list[float], count: int, generator: np.random.Generator) -> np.ndarray:
    """[count, 1] uniform between two limits."""
    low, high = limits
    return generator.uniform(low, high, (count, 1))


def _frames(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """[..., 3] x 2, orthonormal -> [..., 3, 3] with the columns first, second, first x second."""
    return np.stack([first, second, np.cross(first, second)], axis=-1)
