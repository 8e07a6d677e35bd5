"""Foreign grasps -> a grasp set of ours, and what can be measured of it."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dmfc.config.grasps import GraspsConfig
from dmfc.config.physics import PhysicsConfig
from dmfc.errors import DmfcError
from dmfc.grasps.check import check, checking_world
from dmfc.grasps.exchange.hand_map import HandMap
from dmfc.grasps.grasp_set import GraspSet
from dmfc.grasps.planner import palm_hits
from dmfc.hand.description import HandDescription
from dmfc.hand.model import HandModel
from dmfc.objects.model import ObjectModel


@dataclass(frozen=True)
class ForeignGrasps:
    """n grasps as a file has them, in metres and radians."""

    T_object_root: np.ndarray
    """[n, 4, 4] pose of their hand's root in the frame of our object."""
    joints: np.ndarray
    """[n, J] angles, in the order of their hand."""
    where: list[str]
    """[n] file and number of each, for messages."""


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
    Raises DmfcError for another hand, another number of joints, or a joint that is more than
    `tolerance` rad beyond its limits (less is clipped).
    """
    matrix = hand_map.matrix(description)
    if foreign.joints.shape[1] != len(hand_map.joints):
        raise DmfcError(
            f"{foreign.where[0]}: {foreign.joints.shape[1]} joint angles, but this format's hand "
            f"'{hand_map.hand}' has {len(hand_map.joints)}: the file is of another hand "
            "(option --hand-map)"
        )
    joints = foreign.joints @ np.linalg.pinv(matrix).T
    deviation = np.abs(joints @ matrix.T - foreign.joints).max(initial=0.0)
    _check_limits(joints, hand, foreign.where, tolerance)
    T_object_palm = foreign.T_object_root @ hand_map.T_root_palm
    position, rotation = T_object_palm[:, :3, 3], T_object_palm[:, :3, :3]
    reference = position + rotation @ hand.palm_reference
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
        notes={"coupling_error": f"{deviation:.4f}", "imported": str(count)},
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


def pick_scale(scales: np.ndarray, wanted: float | None, source: Path) -> np.ndarray:
    """Rows [m] of the grasps made for one size of the object.

    Raises DmfcError if there are several sizes and none is asked for, or not the one asked for.
    """
    sizes = ", ".join(f"{size:g}" for size in np.unique(scales)[:8])
    if wanted is None:
        if len(np.unique(scales)) > 1:
            raise DmfcError(
                f"{source}: grasps for several sizes of the object ({sizes}): choose "
                "one with --scale"
            )
        return np.arange(len(scales))
    rows = np.flatnonzero(np.isclose(scales, wanted, rtol=1e-3))
    if not len(rows):
        raise DmfcError(f"{source}: no grasp for --scale {wanted:g}; there are {sizes}")
    return rows


def _check_limits(joints: np.ndarray, hand: HandModel, where: list[str], tolerance: float) -> None:
    beyond = np.maximum(hand.lower - joints, joints - hand.upper)
    if beyond.max(initial=-np.inf) <= tolerance:
        return
    row, dof = np.unravel_index(np.argmax(beyond), beyond.shape)
    raise DmfcError(
        f"{where[row]}: joint {hand.dof_names[dof]} at {joints[row, dof]:.3f} rad is out of its "
        f"limits {hand.lower[dof]:.3f} to {hand.upper[dof]:.3f} (option --tolerance clips)"
    )
