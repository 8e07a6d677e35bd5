"""DexGraspNet's `.npy`: a list of dicts with `qpos` by name and the `scale` of the mesh."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from dmfc.errors import DmfcError
from dmfc.geometry.transforms import transform
from dmfc.grasps.exchange.foreign import ForeignGrasps, numbers, size
from dmfc.grasps.exchange.objects_file import load_objects
from dmfc.objects.model import ObjectModel

SUFFIX = ".npy"
_TOLERANCE = 0.15
"""Share by which a mesh may reach farther, or less far, than the scale: decomposed ones differ."""
_POSITION = ("WRJTx", "WRJTy", "WRJTz")
_ANGLES = ("WRJRx", "WRJRy", "WRJRz")
"""Euler angles about the fixed axes x, y, z in turn."""


def read(paths: Sequence[Path], joint_names: Sequence[str]) -> ForeignGrasps:
    """All grasps, in the frame of their mesh times the scale.

    Raises DmfcError if a file is something else, or a joint is missing.
    """
    rows, scales, where = [], [], []
    names = (*_POSITION, *_ANGLES, *joint_names)
    for path in paths:
        for number, grasp in enumerate(load_objects(path)):
            place = f"{path}#{number}"
            rows.append(_row(grasp, names, place))
            scales.append(size(grasp.get("scale", 1.0), place, "scale"))
            where.append(place)
    if not rows:
        raise DmfcError(f"{paths[0]}: no grasps in it")
    values = np.array(rows)
    rotation = Rotation.from_euler("xyz", values[:, 3:6]).as_matrix()
    return ForeignGrasps.of(transform(rotation, values[:, :3]), values[:, 6:], where, scales)


def in_frame(foreign: ForeignGrasps, model: ObjectModel) -> ForeignGrasps:
    """The grasps in the frame of `model`, which is that of their mesh.

    Raises DmfcError where the model has another size: theirs fill a ball of the scale's radius.
    """
    scale = float(foreign.scales[0])
    reach = float(np.linalg.norm(model.vertices, axis=1).max())
    if abs(reach / scale - 1) > _TOLERANCE:
        raise DmfcError(
            f"{foreign.where[0]}: scale {scale:g}, but '{model.id}' reaches {reach:.4g} m from its "
            "origin: another object or size (option --object; a mesh in metres takes ?unit=m)"
        )
    return foreign


def _row(grasp: object, names: Sequence[str], place: str) -> np.ndarray:
    qpos = grasp.get("qpos") if isinstance(grasp, dict) else None
    if not isinstance(qpos, dict):
        raise DmfcError(f"{place}: not a grasp of DexGraspNet (a dict with 'qpos')")
    missing = [name for name in names if name not in qpos]
    if missing:
        raise DmfcError(
            f"{place}: no angle of '{missing[0]}': the file is of another hand (option --hand-map)"
        )
    return numbers([qpos[name] for name in names], len(names), place, "qpos")
