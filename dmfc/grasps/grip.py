"""Power or precision: which parts of the hand hold the object.

Napier (1956) parts grasps in two, and the taxonomies of Cutkosky (1989) and of Feix et al. (2016)
keep that as their first division: in a power grasp the object lies against the palm and the roots
of the fingers, in a precision grasp the fingertips alone hold it. Feix et al. add an intermediate
class. Here the parts that touch decide, by signed distances at the stored grasp:

- power: the palm, or a link of a finger that is farther from its tip than the last two phalanges;
- precision: the last phalanx of each finger, and nothing else;
- intermediate: no such part, but a last phalanx but one.

Phalanges are the links that have inner points, so another hand needs no more data than it has.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch

from dmfc.grasps.grasp_set import GraspSet
from dmfc.hand.kinematics import HandKinematics
from dmfc.hand.model import HandModel
from dmfc.objects.model import ObjectModel

GRIPS = ("none", "precision", "intermediate", "power")
"""Classes, in the order of their numbers; none: nothing touches."""
TOUCH = 0.002
"""A link touches if a point of its surface is within this of the object, metres."""
_ROWS = 64
"""Grasps whose points are placed at a time: bounds memory."""


def link_ranks(hand: HandModel) -> np.ndarray:
    """[L] what a link makes of a grasp that it touches: 1 precision, 2 intermediate, 3 power."""
    has_inner = np.bincount(hand.inner_link, minlength=hand.links) > 0
    beyond = np.zeros(hand.links, dtype=np.int64)  # phalanges between a link and the finger's tip
    for link in range(hand.links - 1, 0, -1):
        parent = hand.parents[link]
        beyond[parent] = max(beyond[parent], beyond[link] + has_inner[link])
    ranks = np.minimum(beyond + 1, 3)
    ranks[0] = 3
    return ranks


def link_distances(grasps: GraspSet, hand: HandModel, model: ObjectModel) -> np.ndarray:
    """[n, L] signed distance of the deepest point of each link, positive inside, metres.

    -inf for a link without points.
    """
    kinematics, points = HandKinematics(hand), []
    T, joints = torch.as_tensor(grasps.T_object_palm), torch.as_tensor(grasps.joints)
    for rows in torch.arange(len(grasps)).split(_ROWS):
        points.append(kinematics.collision_points(T[rows], joints[rows]).numpy())
    distance = np.full((len(grasps), hand.links), -np.inf)
    if points:
        depth = model.sdf.distance(np.concatenate(points))
        for link in np.unique(hand.collision_link):
            distance[:, link] = depth[:, hand.collision_link == link].max(axis=1)
    return distance


def grips(
    grasps: GraspSet, hand: HandModel, model: ObjectModel, touch: float = TOUCH
) -> np.ndarray:
    """[n] number of each grasp's class in `GRIPS`."""
    touching = link_distances(grasps, hand, model) >= -touch
    return np.max(touching * link_ranks(hand), axis=1, initial=0)


def grip_row(classes: np.ndarray) -> dict[str, Any]:
    """Shares of the classes [n] among the grasps, None without any; what is missing to 1 is none
    or intermediate."""
    return {
        name: float((classes == GRIPS.index(name)).mean()) if len(classes) else None
        for name in ("power", "precision")
    }
