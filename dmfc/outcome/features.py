"""Features of a grasp before it is executed: numbers of the hand and the cloud around it.

No model of the object is used, nor which object a point belongs to: an object is what hangs
together with the grasp's seed point.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from dmfc.grasps.grasps import Grasps
from dmfc.hand.model import HandModel
from dmfc.hand.pose_kernel import link_poses
from dmfc.outcome.cells_kernel import fill_cells
from dmfc.outcome.closure_kernel import (
    NEAR,
    close_on_cloud,
    contacts_of_closure,
    gaps_at,
    weakest_support,
)
from dmfc.outcome.object_kernel import COLUMNS, objects_in_palm
from dmfc.outcome.solid import solid_field

REACH = 0.02
"""Metres beyond which the cloud is far from a point of the hand."""
STEPS = 12
"""Poses of the closing fingers that are tried."""
LINKED = 0.015
"""Metres between points of a cloud that hang together."""
GRIP = 0.04
"""Metres ahead of the palm's inner surface, where an object is when it is held."""
FRICTION, TORQUE_WEIGHT = 0.7, 10.0
_POSTURES = "closed", "open"
_OF_BONES = "gap", "ahead", "depth"
_OF_HANDS = "gap", "ahead", "depth", "blocked", "lowest"


@dataclass(frozen=True)
class SeededGrasps(Grasps):
    """n grasps in a scene, as features need them; world frame, z up."""

    seed_point: np.ndarray
    """[n] i64 point of the cloud that each was proposed at."""
    confidence: np.ndarray
    """[n] of the network; NaN where there was none."""


class FeatureMaker:
    """Features of one hand's grasps."""

    def __init__(self, hand: HandModel) -> None:
        self.hand = hand
        self._group = _finger_of_link(hand)[hand.inner_link]
        self._bone = np.unique(hand.inner_link, return_inverse=True)[1]

    @property
    def fingers(self) -> int:
        """Groups of links: the palm, then the fingers."""
        return int(_finger_of_link(self.hand).max()) + 1

    def __call__(self, grasps: SeededGrasps, points: np.ndarray) -> np.ndarray:
        """[n, F] float32 of grasps in a cloud [N, 3] that stands on the table z = 0."""
        cloud = _Cloud(np.ascontiguousarray(points, dtype=np.float64))
        if not len(grasps):
            return np.zeros((0, len(self.names)), dtype=np.float32)
        parts = [
            self._plain(grasps),
            self._gaps(grasps, cloud),
            self._closure(grasps, cloud),
            self._object(grasps, cloud),
        ]
        return np.concatenate(parts, axis=1).astype(np.float32)

    @cached_property
    def names(self) -> list[str]:
        """[F] of the features, in order."""
        bones = [f"bone{k}" for k in range(int(self._bone.max()) + 1)]
        fingers = range(1, self.fingers)
        axes = "xyz"
        return [
            "logit",
            *(f"up_{c}" for c in axes),
            "height",
            *(f"joint{k}" for k in range(self.hand.dofs)),
            *(f"{how}_{what}_{b}" for how in _POSTURES for what in _OF_BONES for b in bones),
            *(f"{how}_{what}" for how in _POSTURES for what in _OF_HANDS),
            *(f"stop{k}" for k in fingers),
            *(f"count{k}" for k in range(self.fingers)),
            *(f"tip{k}_{c}" for k in fingers for c in axes),
            *(f"push{k}_{c}" for k in fingers for c in axes),
            "touching_fingers", "opposed", "balance", "force_support", "wrench_support", "lift",
            *(f"contact_{c}" for c in axes),
            *(f"arm_{c}" for c in axes),
            "arm_sideways",
            *(f"{what}_{c}" for what in ("centre", "low", "high", "spread", "near") for c in axes),
            "share_of_points", "sideways", "share_near", "others_beside", "others_gap",
            "object_height", "object_long", "object_wide",
            *(f"seed_{c}" for c in axes),
        ]  # fmt: skip

    def _plain(self, grasps: SeededGrasps) -> np.ndarray:
        """Confidence, gravity, height and joints."""
        sure = np.clip(grasps.confidence, 1e-4, 1 - 1e-4)
        logit = np.log(sure / (1 - sure))
        up, height = grasps.rotation[:, 2, :], grasps.position[:, 2:]
        return np.concatenate([logit[:, None], up, height, grasps.joints], axis=1)

    def _gaps(self, grasps: SeededGrasps, cloud: _Cloud) -> np.ndarray:
        """Per link with inner points, closed and open: how far from, and how deep in the cloud."""
        hand, count = self.hand, len(grasps)
        R, t = np.ascontiguousarray(grasps.rotation), np.ascontiguousarray(grasps.position)
        link, inner = hand.inner_link, hand.inner_points
        joints = np.clip(grasps.joints, hand.lower, hand.upper)
        of_bones, of_hands = [], []
        for angles in (joints, hand.opened(joints)):
            gap, ahead = np.empty((2, count, len(link)))
            places = np.empty((count, len(link), 3))
            poses, normals = link_poses(hand, angles), hand.inner_normals
            gaps_at(R, t, poses, link, inner, normals, *cloud.cells, gap, ahead, places)  # type: ignore[call-arg]
            depth, blocked = cloud.solid(places)
            of_bones += [self._least(gap), self._least(ahead), -self._least(-depth)]
            of_hands += [gap.min(1), ahead.min(1), depth.max(1), blocked.mean(1)]
            of_hands.append(places[..., 2].min(1))
        return np.concatenate([*of_bones, np.stack(of_hands, axis=1)], axis=1)

    def _least(self, values: np.ndarray) -> np.ndarray:
        """[n, V] -> [n, B] least of each link's inner points."""
        out = np.full((len(values), int(self._bone.max()) + 1), np.inf)
        for v, bone in enumerate(self._bone):
            out[:, bone] = np.minimum(out[:, bone], values[:, v])
        return out

    def _closure(self, grasps: SeededGrasps, cloud: _Cloud) -> np.ndarray:
        """Where fingers stop when they close on the cloud, and what such contacts could resist."""
        hand, count, inner = self.hand, len(grasps), len(self.hand.inner_link)
        poses = self._closing(grasps.joints)
        stop = np.empty((count, self.fingers), dtype=np.int64)
        gap = np.empty((count, inner))
        R, t = np.ascontiguousarray(grasps.rotation), np.ascontiguousarray(grasps.position)
        group, link, points = self._group, hand.inner_link, hand.inner_points
        seen, cell, low, starts, order = cloud.fine_cells
        close_on_cloud(R, t, poses, group, link, points, seen, cell, low, starts, order, stop, gap)
        position, direction = np.empty((2, count, inner, 3))
        contacts_of_closure(
            poses, group, link, points, hand.inner_normals, stop, position, direction
        )
        touching = gap < NEAR
        touched = stop < STEPS
        return self._told(grasps, cloud, stop, touched, touching, position, direction)

    def _closing(self, joints: np.ndarray) -> np.ndarray:
        """T_palm_link [n, S, L, 4, 4] from the open to the squeezed hand."""
        hand = self.hand
        joints = np.clip(joints, hand.lower, hand.upper)
        share = np.linspace(-hand.closing.opening, hand.closing.squeeze, STEPS)[None, :, None]
        angles = np.clip(joints[:, None] + share * hand.flexion, hand.lower, hand.upper)
        flat = link_poses(hand, angles.reshape(-1, hand.dofs))
        return flat.reshape(len(joints), STEPS, *flat.shape[1:])

    def _told(
        self,
        grasps: SeededGrasps,
        cloud: _Cloud,
        stop: np.ndarray,
        touched: np.ndarray,
        touching: np.ndarray,
        position: np.ndarray,
        direction: np.ndarray,
    ) -> np.ndarray:
        counts = _sums(touching.astype(np.float64)[..., None], self._group, self.fingers)[..., 0]
        touching = touching & (touched[:, self._group] | (self._group == 0))
        weight = np.where(touching, 1.0, 1e-6)[..., None]
        total = _sums(weight, self._group, self.fingers)
        tips = _sums(weight * position, self._group, self.fingers) / total
        push = _sums(weight * direction, self._group, self.fingers) / total
        mean_push = (weight * direction).sum(1) / weight.sum(1)
        contact = (weight * position).sum(1) / weight.sum(1)
        centre = _in_palm(grasps, cloud.centre_at(grasps.seed_point))
        up = grasps.rotation[:, 2, :]
        thumb = push[:, -1]
        others = push[:, 1:-1].sum(1)
        opposed = -(thumb * others).sum(1) / np.maximum(
            np.linalg.norm(thumb, axis=1) * np.linalg.norm(others, axis=1), 1e-6
        )
        arm = centre - contact
        sideways = np.linalg.norm(arm - (arm * up).sum(1, keepdims=True) * up, axis=1)
        along_up = (direction * up[:, None]).sum(2)
        lift = along_up + FRICTION * np.sqrt(np.maximum(1 - along_up**2, 0))
        support = [
            _support(position, direction, touching, contact, _FORCES),
            _support(position, direction, touching, contact, _WRENCHES),
        ]
        alone = [
            touched[:, 1:].sum(1),
            opposed,
            np.linalg.norm(mean_push, axis=1),
            *support,
            np.where(touching, lift, -1.0).max(1),
        ]
        flat = [tips[:, 1:].reshape(len(grasps), -1), push[:, 1:].reshape(len(grasps), -1)]
        return np.concatenate(
            [stop[:, 1:], counts, *flat, np.stack(alone, axis=1), contact, arm, sideways[:, None]],
            axis=1,
        )

    def _object(self, grasps: SeededGrasps, cloud: _Cloud) -> np.ndarray:
        """The object that hangs together with the seed point, from the palm."""
        ahead = self.hand.palm_reference + GRIP * self.hand.palm_normal
        R, t = np.ascontiguousarray(grasps.rotation), np.ascontiguousarray(grasps.position)
        target = cloud.label[grasps.seed_point]
        columns = np.empty((len(grasps), COLUMNS))
        objects_in_palm(R, t, t + R @ ahead, cloud.points, cloud.label, target, columns)
        seed = _in_palm(grasps, cloud.points[grasps.seed_point])
        return np.concatenate([columns, cloud.size[target], seed], axis=1)


class _Cloud:
    """A cloud [N, 3] and what is made of it once."""

    def __init__(self, points: np.ndarray) -> None:
        self.points = points
        self.cells: tuple[Any, ...] = (points, REACH, *fill_cells(points, REACH))
        self.fine_cells: tuple[Any, ...] = (points, NEAR, *fill_cells(points, NEAR))
        self.solid = solid_field(points)
        pairs = cKDTree(points).query_pairs(LINKED, output_type="ndarray")
        links = coo_matrix((np.ones(len(pairs), bool), pairs.T), (len(points), len(points)))
        found, self.label = connected_components(links, directed=False)
        self.label = self.label.astype(np.int64)
        members = [points[self.label == k] for k in range(found)]
        self.size = np.array([_size(points) for points in members])
        self._centre = np.array([points.mean(0) for points in members])

    def centre_at(self, seed_point: np.ndarray) -> np.ndarray:
        """[n, 3] mean of what hangs together with a point [n]."""
        return self._centre[self.label[seed_point]]


def _size(points: np.ndarray) -> np.ndarray:
    """[3] height, and the longer and shorter spread over the table, metres."""
    flat = points[:, :2] - points[:, :2].mean(0)
    spread = np.sqrt(np.maximum(np.linalg.eigvalsh(flat.T @ flat / len(flat)), 0))
    return np.array([points[:, 2].max(), spread[1], spread[0]])


def _in_palm(grasps: SeededGrasps, points: np.ndarray) -> np.ndarray:
    """Points [n, 3] of the world in the palm frames [n, 3]."""
    return np.einsum("nij,ni->nj", grasps.rotation, points - grasps.position)


def _sums(values: np.ndarray, group: np.ndarray, groups: int) -> np.ndarray:
    """[n, V, k] -> [n, G, k] summed by group [V]."""
    out = np.zeros((len(values), groups, values.shape[2]))
    for v, g in enumerate(group):
        out[:, g] += values[:, v]
    return out


def _support(
    position: np.ndarray,
    direction: np.ndarray,
    touching: np.ndarray,
    centre: np.ndarray,
    directions: np.ndarray,
) -> np.ndarray:
    out = np.empty(len(position))
    weakest_support(position, direction, touching, centre, directions, FRICTION, TORQUE_WEIGHT, out)
    return out


def _finger_of_link(hand: HandModel) -> np.ndarray:
    """[L] 0 for the palm, then a number for each chain of links that begins at the palm."""
    finger = np.zeros(hand.links, dtype=np.int64)
    found = 0
    for link in range(1, hand.links):
        if hand.parents[link] == 0:
            found += 1
            finger[link] = found
        else:
            finger[link] = finger[hand.parents[link]]
    return finger


def _sign_directions(axes: int) -> np.ndarray:
    """[2^axes, 6] corners of a cube in the first `axes` of the six, unit length."""
    grid = np.stack(np.meshgrid(*([[-1.0, 1.0]] * axes), indexing="ij"), -1).reshape(-1, axes)
    return np.pad(grid / np.sqrt(axes), ((0, 0), (0, 6 - axes)))


_FORCES = np.concatenate([_sign_directions(3), np.eye(6)[:3], -np.eye(6)[:3]])
_WRENCHES = _sign_directions(6)
