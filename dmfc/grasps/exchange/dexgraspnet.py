"""DexGraspNet's `.npy`: a list of dicts with `qpos` by name and the `scale` of the mesh."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from dmfc.errors import DmfcError
from dmfc.geometry.transforms import transform
from dmfc.grasps.exchange.convert import ForeignGrasps, pick_scale
from dmfc.grasps.exchange.objects_file import load_objects

SUFFIX = ".npy"
_POSITION = ("WRJTx", "WRJTy", "WRJTz")
_ANGLES = ("WRJRx", "WRJRy", "WRJRz")
"""Euler angles about the fixed axes x, y, z in turn."""


def read(paths: Sequence[Path], joint_names: Sequence[str], scale: float | None) -> ForeignGrasps:
    """All grasps for one size of the object, whose frame is that of their mesh times the scale.

    Raises DmfcError if a file is something else, a joint is missing, or sizes are mixed.
    """
    rows, scales, where = [], [], []
    names = (*_POSITION, *_ANGLES, *joint_names)
    for path in paths:
        for number, grasp in enumerate(load_objects(path)):
            place = f"{path}#{number}"
            rows.append(_row(grasp, names, place))
            scales.append(float(grasp.get("scale", 1.0)))
            where.append(place)
    if not rows:
        raise DmfcError(f"{paths[0]}: no grasps in it")
    chosen = pick_scale(np.array(scales), scale, paths[0])
    values = np.array(rows)[chosen]
    rotation = Rotation.from_euler("xyz", values[:, 3:6]).as_matrix()
    pose = transform(rotation, values[:, :3])
    return ForeignGrasps(pose, values[:, 6:], [where[row] for row in chosen])


def _row(grasp: object, names: Sequence[str], place: str) -> list[float]:
    qpos = grasp.get("qpos") if isinstance(grasp, dict) else None
    if not isinstance(qpos, dict):
        raise DmfcError(f"{place}: not a grasp of DexGraspNet (a dict with 'qpos')")
    missing = [name for name in names if name not in qpos]
    if missing:
        raise DmfcError(
            f"{place}: no angle of '{missing[0]}': the file is of another hand (option --hand-map)"
        )
    return [float(qpos[name]) for name in names]
