"""Foreign grasps -> a grasp set of ours, and what can be measured of it."""

from __future__ import annotations

import dataclasses

import numpy as np
from scipy.spatial import cKDTree

from dmfc.config.grasps import GraspsConfig
from dmfc.config.physics import PhysicsConfig
from dmfc.errors import DmfcError
from dmfc.grasps.check import check, checking_world
from dmfc.grasps.exchange.foreign import ForeignGrasps
from dmfc.grasps.exchange.hand_map import HandMap
from dmfc.grasps.grasp_set import GraspSet
from dmfc.grasps.palm_hits import palm_hits
from dmfc.hand.description import HandDescription
from dmfc.hand.model import HandModel
from dmfc.objects.model import ObjectModel

REACH = 0.2
"""Metres: a hand farther than its own length from an object does not grasp it."""


def to_grasp_set(
    foreign: ForeignGrasps,
    hand_map: HandMap,
    hand: HandModel,
    description: HandDescription,
    model: ObjectModel,
    config: GraspsConfig,
    tolerance: float = 0.01,
) -> GraspSet:
    """The grasps with our hand. Q1, penetration, robustness and contacts are NaN: not measured.

    Where several of their joints are one degree of freedom of ours (J1 and J2 of a finger), it
    gets the angle nearest to all of them; the note `coupling_error` has the largest deviation, rad.
    A grasp of which a joint is more than `tolerance` rad beyond its limits is skipped, and counted
    in the note `skipped`; less is clipped. Raises DmfcError for another hand, another number of
    joints, grasps out of reach of the object, or where all are skipped.
    """
    matrix = hand_map.matrix(description)
    if foreign.joints.shape[1] != len(hand_map.joints):
        raise DmfcError(
            f"{foreign.where[0]}: {foreign.joints.shape[1]} joint angles, but this format's hand "
            f"'{hand_map.hand}' has {len(hand_map.joints)}: the file is of another hand "
            "(option --hand-map)"
        )
    joints = foreign.joints @ np.linalg.pinv(matrix).T
    allowed = np.flatnonzero(_within_limits(joints, hand, tolerance))
    if not len(allowed):
        raise DmfcError(_beyond(joints[0], hand, foreign.where[0]))
    skipped = len(joints) - len(allowed)
    foreign, joints = foreign[allowed], joints[allowed]
    deviation = np.abs(joints @ matrix.T - foreign.joints).max(initial=0.0)
    T_object_palm = foreign.T @ hand_map.T_root_palm
    position, rotation = T_object_palm[:, :3, 3], T_object_palm[:, :3, :3]
    reference = position + rotation @ hand.palm_reference
    _require_near(reference, model, foreign.where)
    count = len(joints)
    return GraspSet(
        object_id=model.id,
        hand=hand.name,
        dof_names=list(hand.dof_names),
        position=position,
        rotation=rotation,
        joints=np.clip(joints, hand.lower, hand.upper),
        palm_hit=palm_hits(model, reference, rotation @ hand.palm_normal, config.palm_reach),
        **{n: np.full(count, np.nan) for n in ("q1", "penetration", "robustness", "contacts")},
        notes={
            "coupling_error": f"{deviation:.4f}",
            "imported": str(count),
            **({"skipped": str(skipped)} if skipped else {}),
        },
    )


def verified(
    grasps: GraspSet,
    hand: HandModel,
    description: HandDescription,
    model: ObjectModel,
    config: GraspsConfig,
    physics: PhysicsConfig,
) -> GraspSet:
    """Those that hold the floating object against gravity from six sides, with what was measured:
    penetration, contacts, and a robustness of 1 for the one check that was made."""
    world = checking_world(description, model, physics, config)
    poses = zip(grasps.T_object_palm, grasps.joints, strict=True)
    verdicts = [check(world, hand, T, joints, config) for T, joints in poses]
    held = np.array([verdict.held for verdict in verdicts], dtype=bool)
    kept = [verdict for verdict in verdicts if verdict.held]
    return dataclasses.replace(
        grasps[held],
        penetration=np.array([verdict.penetration for verdict in kept]),
        contacts=np.array([verdict.contacts for verdict in kept], dtype=np.float64),
        robustness=np.ones(len(kept)),
        notes={**grasps.notes, "checked": str(len(grasps)), "held": str(len(kept))},
    )


def _within_limits(joints: np.ndarray, hand: HandModel, tolerance: float) -> np.ndarray:
    """[n] whether all joints [n, D] are at most `tolerance` rad beyond their limits."""
    return (np.maximum(hand.lower - joints, joints - hand.upper) <= tolerance).all(axis=1)


def _beyond(joints: np.ndarray, hand: HandModel, where: str) -> str:
    """What is wrong with a grasp of joints [D] out of limits."""
    dof = int(np.argmax(np.maximum(hand.lower - joints, joints - hand.upper)))
    return (
        f"{where}: joint {hand.dof_names[dof]} at {joints[dof]:.3f} rad is out of its "
        f"limits {hand.lower[dof]:.3f} to {hand.upper[dof]:.3f} (option --tolerance clips)"
    )


def _require_near(reference: np.ndarray, model: ObjectModel, where: np.ndarray) -> None:
    """Raises DmfcError where most palms [n, 3] are out of reach of the object."""
    distance = cKDTree(model.surface_points).query(reference)[0]
    if np.median(distance) > REACH:
        far = int(np.argmax(distance))
        raise DmfcError(
            f"{where[far]}: the palm is {distance[far]:.3g} m from '{model.id}': the grasps are "
            "for another object, another size, or in another frame (option --object)"
        )
