"""Which ground-truth grasps survive in a scene: those clear of the table and of the neighbours."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import torch

from dmfc.config.scenes import ScenesConfig
from dmfc.geometry import transforms
from dmfc.grasps.grasp_set import GraspSet
from dmfc.hand.approach import Approach
from dmfc.hand.kinematics import HandKinematics
from dmfc.hand.model import HandModel
from dmfc.objects.model import ObjectModel

REASONS = ("table", "neighbour", "limit")
"""Why a label is dropped: hand in the table, hand in another object, or scenes.max_grasps full."""


@dataclass(frozen=True)
class Labels:
    """Surviving labels of a scene as references into the objects' grasp sets."""

    grasp_object: np.ndarray
    """[n] uint8: index of the object in the scene."""
    grasp_index: np.ndarray
    """[n] int32: row of that object's grasp set; the most robust first within an object."""
    dropped: dict[str, int]
    """Reason (one of `REASONS`) -> labels lost."""


class HandAtGrasps:
    """Link poses of the hand at the grasps of objects, kept by object (3 kB per grasp)."""

    def __init__(self, hand: HandModel) -> None:
        self._hand, self._kinematics = hand, HandKinematics(hand)
        self._kept: dict[tuple[str, bool], np.ndarray] = {}
        present = np.unique(hand.collision_link)
        self._pieces = [_Piece(int(i), hand) for i in present]

    def links(self, grasps: GraspSet, *, opened: bool = False) -> np.ndarray:
        """T_object_link [n, L, 4, 4] at the n grasps of a set, or before the fingers close."""
        key = grasps.object_id, opened
        if key not in self._kept:
            joints = self._hand.opened(grasps.joints) if opened else grasps.joints
            T_object_palm = torch.as_tensor(grasps.T_object_palm)
            with torch.no_grad():
                links = self._kinematics.links(T_object_palm, torch.as_tensor(joints))
            self._kept[key] = links.numpy()
        return self._kept[key]

    def lowest(self, T_world_link: np.ndarray) -> np.ndarray:
        """z of the lowest collision point of hands with links at [n, L, 4, 4]: [n]."""
        lowest = [
            (T_world_link[:, p.link, 2, :3] @ p.points.T).min(1) + T_world_link[:, p.link, 2, 3]
            for p in self._pieces
        ]
        return np.min(lowest, axis=0)

    def deepest(self, T_object_link: np.ndarray, model: ObjectModel) -> np.ndarray:
        """Depth in an object of the deepest collision point of hands with links at [n, L, 4, 4] in
        its frame: [n], metres; -inf where no point comes within the object's bounds."""
        deepest = np.full(len(T_object_link), -np.inf)
        low, high = model.hull_vertices.min(0), model.hull_vertices.max(0)
        candidates: list[tuple[np.ndarray, np.ndarray]] = []
        for piece in self._pieces:
            T = T_object_link[:, piece.link]
            centre = T[:, :3, :3] @ piece.centre + T[:, :3, 3]
            outside = centre - np.clip(centre, low, high)
            rows = np.flatnonzero((outside**2).sum(1) <= piece.radius**2)
            if len(rows):
                points = transforms.apply(T[rows], piece.points).reshape(-1, 3)
                near = _within(points, low, high)
                candidates.append((rows[near // len(piece.points)], points[near]))
        if candidates:
            rows, points = (np.concatenate(values) for values in zip(*candidates, strict=True))
            np.maximum.at(deepest, rows, model.sdf.distance(points))
        return deepest


class _Piece:
    """The collision points of one link, and a ball around them; link frame."""

    def __init__(self, link: int, hand: HandModel) -> None:
        self.link = link
        self.points = hand.collision_points[hand.collision_link == link]
        self.centre = (self.points.min(0) + self.points.max(0)) / 2
        self.radius = np.linalg.norm(self.points - self.centre, axis=1).max()


def surviving_labels(
    config: ScenesConfig,
    models: Sequence[ObjectModel],
    T_world_object: np.ndarray,
    grasps: Mapping[str, GraspSet],
    hand: HandAtGrasps,
) -> Labels:
    """Labels of all objects of a scene whose hand is clear of the table and of the other objects.

    The hand's collision points are tested, at the grasp and open just before it: a grasp is dropped
    if one of them is deeper than `scenes.approach_tolerance` in the table or in a neighbour. An
    object that is not in `grasps` has no labels. At most `scenes.max_grasps` per object stay, the
    most robust.
    """
    approach, dropped = Approach.of_labels(config), dict.fromkeys(REASONS, 0)
    objects, rows = [], []
    for index, model in enumerate(models):
        of_object = grasps.get(model.id)
        if of_object is None or len(of_object) == 0:
            continue
        order = np.argsort(-of_object.robustness, kind="stable")
        T_world_hands = [
            T_world_object[index] @ hand.links(of_object, opened=opened)[order]
            for opened in (False, True)
        ]
        height = np.min([hand.lowest(T) for T in T_world_hands], axis=0)
        is_clear = -height <= approach.table_tolerance
        dropped["table"] += int((~is_clear).sum())
        order = order[is_clear]
        depth = np.full(len(order), -np.inf)
        for other, neighbour in enumerate(models):
            if other != index and len(order):
                T_other_world = transforms.inverse(T_world_object[other])
                for T in T_world_hands:
                    inside = hand.deepest(T_other_world @ T[is_clear], neighbour)
                    depth = np.maximum(depth, inside)
        dropped["neighbour"] += int((depth > approach.tolerance).sum())
        order = order[depth <= approach.tolerance]
        dropped["limit"] += max(0, len(order) - config.max_grasps)
        rows.append(order[: config.max_grasps])
        objects.append(np.full(len(rows[-1]), index))
    if not rows:
        return Labels(np.zeros(0, np.uint8), np.zeros(0, np.int32), dropped)
    return Labels(
        np.concatenate(objects).astype(np.uint8), np.concatenate(rows).astype(np.int32), dropped
    )


def _within(points: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Indices of the points [n, 3] in the box low..high [3], axis after axis."""
    near = np.arange(len(points))
    for axis in range(3):
        values = points[near, axis]
        near = near[(values >= low[axis]) & (values <= high[axis])]
    return near
