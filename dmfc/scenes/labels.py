"""Which ground-truth grasps survive in a scene: those clear of the table and of the neighbours."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import torch

from dmfc.config.scenes import ScenesConfig
from dmfc.geometry import transforms
from dmfc.grasps.grasp_set import GraspSet
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


class HandPoints:
    """The hand's collision points at an object's grasps, in the object's frame; the last used are
    kept (about 24 kB per grasp)."""

    def __init__(self, hand: HandModel, kept: int = 16) -> None:
        self._kinematics = HandKinematics(hand)
        self._kept = kept
        self._points: OrderedDict[str, np.ndarray] = OrderedDict()

    def at(self, grasps: GraspSet) -> np.ndarray:
        """[n, P, 3] float32 at the n grasps of a set."""
        key = grasps.object_id
        if key not in self._points:
            T_object_palm = torch.as_tensor(grasps.T_object_palm, dtype=torch.float32)
            joints = torch.as_tensor(grasps.joints, dtype=torch.float32)
            with torch.no_grad():
                points = self._kinematics.collision_points(T_object_palm, joints)
            self._points[key] = points.numpy()
            if len(self._points) > self._kept:
                self._points.popitem(last=False)
        self._points.move_to_end(key)
        return self._points[key]


def surviving_labels(
    config: ScenesConfig,
    models: Sequence[ObjectModel],
    T_world_object: np.ndarray,
    grasps: Mapping[str, GraspSet],
    hand: HandPoints,
) -> Labels:
    """Labels of all objects of a scene whose hand is clear of the table and of the other objects.

    The hand's collision points are tested: a grasp is dropped if one of them is deeper than
    `scenes.clearance` below the table plane or within a neighbour. An object that is not in
    `grasps` has no labels. At most `scenes.max_grasps` per object stay, the most robust.
    """
    dropped = dict.fromkeys(REASONS, 0)
    objects, rows = [], []
    for index, model in enumerate(models):
        own = grasps.get(model.id)
        if own is None or len(own) == 0:
            continue
        order = np.argsort(-own.robustness, kind="stable")
        points = hand.at(own)
        is_clear = _table_depth(points, T_world_object[index]) <= config.clearance
        dropped["table"] += int((~is_clear).sum())
        order = order[is_clear[order]]
        depth = _neighbour_depth(points[order], index, models, T_world_object)
        dropped["neighbour"] += int((depth > config.clearance).sum())
        order = order[depth <= config.clearance]
        dropped["limit"] += max(0, len(order) - config.max_grasps)
        rows.append(order[: config.max_grasps])
        objects.append(np.full(len(rows[-1]), index))
    if not rows:
        return Labels(np.zeros(0, np.uint8), np.zeros(0, np.int32), dropped)
    return Labels(
        np.concatenate(objects).astype(np.uint8), np.concatenate(rows).astype(np.int32), dropped
    )


def _table_depth(points: np.ndarray, T_world_object: np.ndarray) -> np.ndarray:
    """How far the lowest of points [n, P, 3] (object frame) is below z = 0: [n], metres."""
    up, height = T_world_object[2, :3].astype(np.float32), T_world_object[2, 3]
    return -(points @ up).min(1) - height


def _neighbour_depth(
    points: np.ndarray, index: int, models: Sequence[ObjectModel], T_world_object: np.ndarray
) -> np.ndarray:
    """Deepest of points [n, P, 3] of object `index`'s frame within any other object: [n], metres.

    Zero or less is clear; points outside a neighbour's bounds are not looked up.
    """
    deepest = np.full(len(points), -np.inf)
    for other, model in enumerate(models):
        if other == index or len(points) == 0:
            continue
        T = transforms.inverse(T_world_object[other]) @ T_world_object[index]
        low, high = model.vertices.min(0), model.vertices.max(0)
        rotation, shift = T[:3, :3].T.astype(np.float32), T[:3, 3].astype(np.float32)
        local = points.reshape(-1, 3) @ rotation + shift
        is_near = np.ones(len(local), dtype=bool)
        for axis in range(3):
            is_near &= (local[:, axis] >= low[axis]) & (local[:, axis] <= high[axis])
        near = np.flatnonzero(is_near)
        depth = model.sdf.distance(local[near])
        np.maximum.at(deepest, near // points.shape[1], depth)
    return deepest
