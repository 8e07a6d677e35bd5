"""Candidates: palm poses guided by the surface, backed off until free, fingers closed on it.

No simulation here: signed distances of points on the hand decide where a hand fits and where each
finger meets the object, for a whole batch at once. What looks like a grasp goes to the check.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import torch

from dmfc.config.grasps import GraspsConfig
from dmfc.hand.description import HandDescription
from dmfc.hand.kinematics import HandKinematics
from dmfc.hand.model import HandModel
from dmfc.objects.model import ObjectModel


@dataclass(frozen=True)
class Candidates:
    """B hands that touch the object. Object frame; float64."""

    position: np.ndarray
    """[B, 3] palm origin, metres."""
    rotation: np.ndarray
    """[B, 3, 3] R_object_palm."""
    preshape: np.ndarray
    """[B, D] rad, before the fingers close; free of the object."""
    joints: np.ndarray
    """[B, D] rad, each finger closed until it touches; one that never does stays open."""
    touching: np.ndarray
    """[B, F] bool, fingers that touch."""
    stable_pose: np.ndarray
    """[B] stable pose of the object in which the hand keeps off the table; -1: not asked for."""

    def __len__(self) -> int:
        return len(self.position)

    def __getitem__(self, rows: np.ndarray) -> Candidates:
        return Candidates(*(getattr(self, name)[rows] for name in self.__dataclass_fields__))


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
        self._thin = _Points(hand.thinned(config.proposal_points))
        self._all = _Points(hand)
        self.finger_of_dof, self.finger_of_link = fingers(hand)

    def draw(self, count: int, generator: np.random.Generator) -> Candidates:
        """At most `count` candidates: those that fit and that at least two fingers close on."""
        pose = self._stable_poses(count, generator)
        support = self._supports(pose)
        position, rotation = self._palms(support, generator)
        preshape = self._preshapes(count, generator)
        position, free = self._back_off(position, rotation, preshape, support)
        found = Candidates(
            position[free],
            rotation[free],
            preshape[free],
            preshape[free],
            np.zeros((int(free.sum()), self.finger_of_dof.max() + 1), dtype=bool),
            pose[free],
        )
        # A few points find the candidates; where exactly the fingers of those touch takes all.
        for points in (self._thin, self._all):
            found = self._close(found, points)
            found = found[found.touching.sum(axis=1) >= 2]
            found = found[self._reachable(found, points)]
        return found

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
        axis = self._finger_axis()
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
        sample = generator.choice(len(self.model.surface_points), size=512)
        ahead = self.model.surface_points[sample].astype(np.float64) - target[:, None]
        depth = np.einsum("bsi,bi->bs", ahead, approach)
        along = np.einsum("bsi,kbi->kbs", ahead, rolls)
        aside = np.einsum("bsi,kbi->kbs", ahead, np.cross(approach, rolls))
        reached = (np.abs(aside) < 0.02) & (depth > -0.01) & (depth < config.finger_reach)
        low = np.where(reached, along, np.inf).min(axis=2)
        high = np.where(reached, along, -np.inf).max(axis=2)
        width = np.where(reached.any(axis=2), high - low, np.inf)
        best = np.argmin(width, axis=0)
        best[generator.uniform(size=count) >= config.straddle_share] = 0
        row = np.arange(count)
        middle = 0.5 * (low + high)[best, row]
        middle[(best == 0) | ~np.isfinite(middle)] = 0.0
        return rolls[best, row], middle[:, None]

    def _targets(self, support: np.ndarray, generator: np.random.Generator) -> np.ndarray:
        """[B] surface points that do not look down on the table."""
        normals = self.model.surface_normals
        rows = generator.integers(len(normals), size=(8, len(support)))
        down = np.einsum("kbi,bi->kb", normals[rows], support[:, :3]) < -0.3
        return rows[np.argmin(down, axis=0), np.arange(len(support))]

    def _reachable(self, closed: Candidates, points: _Points) -> np.ndarray:
        """[B] whether the hand keeps off the table, and gets there open without hitting the object.

        The way there is along the palm normal, from as far as the trials of execution come.
        """
        if not len(closed):
            return np.zeros(0, dtype=bool)
        support = self._supports(closed.stable_pose)
        opened = points.at(closed.position, closed.rotation, self.hand.opened(closed.joints))
        at_grasp = points.at(closed.position, closed.rotation, closed.joints)
        heights = np.minimum(_heights(opened, support), _heights(at_grasp, support))
        rows = np.flatnonzero(heights.min(axis=1) > 0.0)
        back = -np.einsum("bij,j->bi", closed.rotation, self.hand.palm_normal)
        for distance in np.linspace(0.0, self.config.approach, self.config.approach_steps):
            if not len(rows):
                break
            moved = opened[rows] + distance * back[rows, None]
            rows = rows[self.model.sdf.distance(moved).max(axis=1) < self.config.approach_depth]
        return np.isin(np.arange(len(closed)), rows)

    def _finger_axis(self) -> np.ndarray:
        """[3] the direction from the palm's centre to the finger tips of the straight hand."""
        hand = self.hand
        T = self._all.kinematics.forward(torch.zeros(1, hand.dofs))[0].numpy()
        tips = T[:, :3, 3] - hand.palm_reference
        axis = tips[np.argmax(np.linalg.norm(tips, axis=1))]
        axis = axis - (axis @ hand.palm_normal) * hand.palm_normal
        return axis / np.linalg.norm(axis)

    def _preshapes(self, count: int, generator: np.random.Generator) -> np.ndarray:
        """Open hands drawn from the description's ranges.

        Joints that close the hand and have the same range, such as the knuckles of all fingers, are
        flexed about alike.
        """
        ranges = self.description.preshape_range
        _, kind = np.unique(ranges, axis=0, return_inverse=True)
        alike = generator.uniform(size=(count, kind.max() + 1))[:, kind.ravel()]
        own = generator.uniform(size=(count, len(ranges)))
        mixed = np.where(self.hand.flexion != 0, 0.7 * alike + 0.3 * own, own)
        lower, upper = ranges.T
        return np.clip(lower + mixed * (upper - lower), self.hand.lower, self.hand.upper)

    def _back_off(
        self,
        position: np.ndarray,
        rotation: np.ndarray,
        preshape: np.ndarray,
        support: np.ndarray,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Move each hand back along its palm normal until it is free; also [B] whether it is."""
        steps = np.arange(0.0, self.config.back_off + 1e-9, self.config.back_off_step)
        at = self._thin.at(position, rotation, preshape)
        back = -np.einsum("bij,j->bi", rotation, self.hand.palm_normal)
        free = np.zeros(len(position), dtype=bool)
        shift = np.zeros(len(position))
        for step in steps:
            todo = np.flatnonzero(~free)
            moved = at[todo] + step * back[todo, None]
            is_above = _heights(moved, support[todo]).min(axis=1) > 0.0
            todo, moved = todo[is_above], moved[is_above]
            now = todo[self.model.sdf.distance(moved).max(axis=1) < -self.config.clearance]
            free[now], shift[now] = True, step
        return position + shift[:, None] * back, free

    def _close(self, candidates: Candidates, points: _Points) -> Candidates:
        """Close every finger from the pre-shape until it touches.

        A finger that never touches stays as it was.
        """
        config, hand = self.config, self.hand
        position, rotation, preshape = (
            candidates.position,
            candidates.rotation,
            candidates.preshape,
        )
        finger = self.finger_of_link[points.hand.collision_link]
        members = [np.flatnonzero(finger == f) for f in range(self.finger_of_dof.max() + 1)]
        touching = np.zeros((len(position), len(members)), dtype=bool)
        closed = np.zeros((len(position), len(members)))
        before = np.full((len(position), len(members)), -np.inf)
        step = config.close_range / config.close_steps
        rows = np.arange(len(position))
        for fraction in step * np.arange(config.close_steps + 1):
            if not len(rows):
                break
            joints = np.clip(preshape[rows] + fraction * hand.flexion, hand.lower, hand.upper)
            distance = self.model.sdf.distance(points.at(position[rows], rotation[rows], joints))
            for f, own in enumerate(members):
                depth = distance[:, own].max(axis=1)
                hit = (depth > 0.0) & ~touching[rows, f]
                # Where the distance, linear between two steps, crosses zero.
                last = before[rows[hit], f]
                share = np.where(np.isfinite(last), depth[hit] / (depth[hit] - last), 0.0)
                closed[rows[hit], f] = fraction - step * share
                touching[rows[hit], f] = True
                before[rows, f] = depth
            rows = rows[~touching[rows].all(axis=1)]
        amount = np.where(self.finger_of_dof >= 0, closed[:, self.finger_of_dof], 0.0)
        joints = np.clip(preshape + amount * hand.flexion, hand.lower, hand.upper)
        return replace(candidates, joints=joints, touching=touching)


class _Points:
    """Points on a hand, placed for a batch of poses."""

    def __init__(self, hand: HandModel) -> None:
        self.hand, self.kinematics = hand, HandKinematics(hand)

    def at(self, position: np.ndarray, rotation: np.ndarray, joints: np.ndarray) -> np.ndarray:
        """[B, p, 3] in the frame of the poses [B, 3], [B, 3, 3]; joints [B, D]."""
        T = torch.eye(4).repeat(len(position), 1, 1)
        T[:, :3, :3] = torch.as_tensor(rotation)
        T[:, :3, 3] = torch.as_tensor(position)
        angles = torch.as_tensor(joints, dtype=torch.float32)
        return self.kinematics.collision_points(T, angles).numpy()


def _between(limits: list[float], count: int, generator: np.random.Generator) -> np.ndarray:
    """[count, 1] uniform between two limits."""
    low, high = limits
    return generator.uniform(low, high, (count, 1))


def _frames(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """[..., 3] x 2, orthonormal -> [..., 3, 3] with the columns first, second, first x second."""
    return np.stack([first, second, np.cross(first, second)], axis=-1)


def _heights(points: np.ndarray, support: np.ndarray) -> np.ndarray:
    """Heights [B, p] of points [B, p, 3] above planes [B, 4]."""
    return np.einsum("bpi,bi->bp", points, support[:, :3]) + support[:, 3:]


def fingers(hand: HandModel) -> tuple[np.ndarray, np.ndarray]:
    """Finger of each degree of freedom [D] and of each link [L]; -1 for the palm.

    A finger is a subtree that hangs on the palm.
    """
    finger_of_link = np.full(hand.links, -1)
    count = 0
    for link in range(1, hand.links):
        parent = hand.parents[link]
        if parent == 0:
            finger_of_link[link], count = count, count + 1
        else:
            finger_of_link[link] = finger_of_link[parent]
    finger_of_dof = np.full(hand.dofs, -1)
    moved = hand.joint_dof >= 0
    finger_of_dof[hand.joint_dof[moved]] = finger_of_link[moved]
    return finger_of_dof, finger_of_link
