"""The checked answer of a method for a scene; each problem is one line."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from dmfc.errors import DmfcError, unknown_name
from dmfc.grasps.grasps import Grasps
from dmfc.methods.observation import Observation

FRAME = "world"
NEEDED = ("position", "joints", "joint_names", "score")
KEYS = (*NEEDED, "rotation", "quaternion", "frame", "point")
MOST = 100_000
"""Grasps of one scene."""
FARTHEST = 1.0
"""m from the cloud to the palm's origin; farther ones are in another frame or unit."""
ORTHOGONAL = 1e-3
"""Greatest entry of R^T R - 1."""
BEYOND = 0.05
"""rad by which a joint may exceed its limits; it is clamped."""
AHEAD = 0.04
"""m from the palm's inner surface to the middle of a grasp, along the palm normal."""


@dataclass(frozen=True)
class Answer(Grasps):
    """n grasps of a scene in its world frame; joints in the hand's order, within its limits."""

    score: np.ndarray
    """[n] float64 of any scale; the best is the largest."""
    point: np.ndarray
    """[n] int64 point of the cloud that is to be grasped."""


def nothing(dofs: int) -> Answer:
    """No grasp at all."""
    empty = np.zeros(0)
    return Answer(
        np.zeros((0, 3)), np.zeros((0, 3, 3)), np.zeros((0, dofs)), empty, empty.astype(np.int64)
    )


def checked(given: Any, seen: Observation) -> Answer:
    """The grasps that a method gives for what it has seen.

    `given` is a mapping: `position` [n, 3] of the palm's origin; `rotation` [n, 3, 3] R_world_palm
    or `quaternion` [n, 4] (w x y z); `joints` [n, D] in rad with `joint_names` [D], in any order;
    `score` [n]; perhaps `frame`, which is 'world', and `point` [n], rows of the cloud that are to
    be grasped (without it, or where it is -1: the point nearest to the middle of the grasp).
    Raises DmfcError on anything else.
    """
    values = _mapping(given)
    position = _numbers(values, "position", (3,))
    count = len(position)
    if count > MOST:
        raise DmfcError(f"{count:,} grasps, more than {MOST:,}")
    rotation = _rotation(values, count)
    joints = _joints(values, count, seen)
    score = _numbers(values, "score", (), count)
    _require_near(position, seen.points)
    centre = seen.hand.palm_reference + AHEAD * seen.hand.palm_normal
    point = _points(values, position + rotation @ centre, seen.points)
    return Answer(position, rotation, joints, score, point)


def _mapping(given: Any) -> Mapping[str, Any]:
    if not isinstance(given, Mapping):
        raise DmfcError(
            f"a method answers with a mapping ({', '.join(NEEDED)}, rotation or quaternion), "
            f"not {type(given).__name__}"
        )
    for name in given:
        if name not in KEYS:
            raise unknown_name("key of an answer", str(name), KEYS)
    lacking = [name for name in NEEDED if given.get(name) is None]
    if lacking:
        raise DmfcError(f"the answer has no {lacking[0]}")
    frame = str(np.asarray(given.get("frame", FRAME)))
    if frame != FRAME:
        raise DmfcError(f"the answer is in the frame '{frame}'; grasps are in the frame '{FRAME}'")
    return given


def _numbers(
    values: Mapping[str, Any], name: str, shape: tuple[int, ...], count: int | None = None
) -> np.ndarray:
    """[n, *shape] float64, finite."""
    try:
        array = np.asarray(values[name], dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise DmfcError(f"{name} holds no numbers ({type(values[name]).__name__})") from error
    if array.size == 0:
        array = array.reshape(0, *shape)
    wanted = ", ".join(["n" if count is None else str(count), *map(str, shape)])
    if array.shape[1:] != shape or array.ndim == 0 or (count is not None and len(array) != count):
        raise DmfcError(f"{name} is {list(array.shape)}, not [{wanted}]")
    wrong = ~np.isfinite(array).all(axis=tuple(range(1, array.ndim)))
    if wrong.any():
        raise DmfcError(f"{name} of grasp {int(wrong.argmax())} is not finite (NaN or infinite)")
    return array


def _rotation(values: Mapping[str, Any], count: int) -> np.ndarray:
    """R_world_palm [n, 3, 3]."""
    names = [name for name in ("rotation", "quaternion") if values.get(name) is not None]
    if len(names) != 1:
        raise DmfcError("an answer has either rotation [n, 3, 3] or quaternion [n, 4] (w x y z)")
    if names == ["quaternion"]:
        turn = _numbers(values, "quaternion", (4,), count)
        short = np.abs(np.linalg.norm(turn, axis=1) - 1) > ORTHOGONAL
        if short.any():
            raise DmfcError(f"quaternion of grasp {int(short.argmax())} has not the length 1")
        return Rotation.from_quat(turn, scalar_first=True).as_matrix().reshape(-1, 3, 3)
    rotation = _numbers(values, "rotation", (3, 3), count)
    off = np.abs(rotation.transpose(0, 2, 1) @ rotation - np.eye(3)).max(axis=(1, 2), initial=0.0)
    bad = (off > ORTHOGONAL) | (np.linalg.det(rotation) < 0)
    if bad.any():
        raise DmfcError(
            f"rotation of grasp {int(bad.argmax())} is no rotation: its columns are to be the "
            "palm's axes, orthogonal, of length 1, right-handed"
        )
    return rotation


def _joints(values: Mapping[str, Any], count: int, seen: Observation) -> np.ndarray:
    """[n, D] in the hand's order, within its limits."""
    hand = seen.hand
    names = [str(name) for name in np.asarray(values["joint_names"]).reshape(-1)]
    given = _numbers(values, "joints", (len(names),), count)
    for name in names:
        if name not in hand.dof_names:
            raise unknown_name(f"joint of the hand '{hand.name}'", name, hand.dof_names)
    if len(set(names)) < len(names):
        raise DmfcError(f"joint_names has '{_twice(names)}' twice")
    lacking = [name for name in hand.dof_names if name not in names]
    if lacking:
        raise DmfcError(f"joint_names lacks '{lacking[0]}' of the hand '{hand.name}'")
    joints = given[:, [names.index(name) for name in hand.dof_names]]
    over = np.maximum(hand.lower - joints, joints - hand.upper)
    if over.size and over.max() > BEYOND:
        row, column = np.unravel_index(over.argmax(), over.shape)
        raise DmfcError(
            f"'{hand.dof_names[column]}' of grasp {row} is {joints[row, column]:.4g} rad; its "
            f"limits are {hand.lower[column]:.4g} and {hand.upper[column]:.4g} rad"
        )
    return np.clip(joints, hand.lower, hand.upper)


def _twice(names: Sequence[str]) -> str:
    return next(name for k, name in enumerate(names) if name in names[:k])


def _require_near(position: np.ndarray, points: np.ndarray) -> None:
    if not len(position):
        return
    distance = cKDTree(points).query(position)[0]
    if distance.max() > FARTHEST:
        worst = int(distance.argmax())
        raise DmfcError(
            f"the palm of grasp {worst} is {distance[worst]:.3g} m from the cloud: positions are "
            f"in metres, in the frame '{FRAME}'"
        )


def _points(values: Mapping[str, Any], centres: np.ndarray, points: np.ndarray) -> np.ndarray:
    """[n] row of the cloud that each grasp is for."""
    count = len(centres)
    if not count:
        return np.zeros(0, dtype=np.int64)
    nearest = cKDTree(points).query(centres)[1].astype(np.int64)
    if values.get("point") is None:
        return nearest
    given = _numbers(values, "point", (), count)
    wrong = (given != np.rint(given)) | (given < -1) | (given >= len(points))
    if wrong.any():
        worst = int(wrong.argmax())
        raise DmfcError(
            f"point of grasp {worst} is {given[worst]:g}: the cloud has the points 0 to "
            f"{len(points) - 1}, and -1 is none"
        )
    return np.where(given < 0, nearest, given.astype(np.int64))
