"""Ground-truth grasps carried into the frame of a scene. NumPy alone: the data loader uses it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from dmfc.geometry import transforms
from dmfc.grasps.grasp_set import GraspSet
from dmfc.grasps.grasps import Grasps


@dataclass(frozen=True)
class SceneGrasps(Grasps):
    """n grasps in the world frame."""

    palm_reference: np.ndarray
    """[n, 3] reference point on the palm."""
    palm_hit: np.ndarray
    """[n, 3] its projection onto the object; NaN where it misses."""
    object_index: np.ndarray
    """[n] index of the object in the scene."""


def grasps_in_scene(
    object_ids: Sequence[str],
    T_world_object: np.ndarray,
    grasp_object: np.ndarray,
    grasp_index: np.ndarray,
    grasps: Mapping[str, GraspSet],
    palm_reference: np.ndarray,
) -> SceneGrasps:
    """Labels (references) as grasps in the world: T_world_palm = T_world_object @ T_object_palm.

    T_world_object: [k, 4, 4]; palm_reference: [3] in the palm frame.
    """
    parts = []
    for index, object_id in enumerate(object_ids):
        rows = grasp_index[grasp_object == index]
        if len(rows) == 0:
            continue
        labels, T = grasps[object_id][rows], T_world_object[index]
        in_world = labels.in_frame(T)
        hit = transforms.apply(T, labels.palm_hit)
        reference = in_world.position + in_world.rotation @ palm_reference
        where = np.full(len(rows), index)
        parts.append((in_world.position, in_world.rotation, in_world.joints, reference, hit, where))
    if not parts:
        dofs = next((len(of_object.dof_names) for of_object in grasps.values()), 0)
        none = np.zeros((0, 3))
        empty = np.zeros((0, 3, 3)), np.zeros((0, dofs))
        return SceneGrasps(none, *empty, none, none, np.zeros(0, dtype=np.int64))
    return SceneGrasps(*(np.concatenate(values) for values in zip(*parts, strict=True)))
