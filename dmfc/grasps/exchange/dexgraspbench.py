"""DexGraspBench: one dict per `.npy` file, and a folder per object, read and written.

Its object frame lies at the centre of the bounding box, its meshes have half the diagonal of that
box as unit, and `obj_scale` is this half-diagonal in metres. `pregrasp_qpos`, `grasp_qpos` and
`squeeze_qpos` hold the root's pose in the world (xyz, wxyz) and the joint angles.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

from dmfc.errors import DmfcError
from dmfc.geometry.transforms import inverse, transform
from dmfc.grasps.exchange.convert import ForeignGrasps
from dmfc.grasps.exchange.hand_map import HandMap
from dmfc.grasps.exchange.objects_file import load_objects
from dmfc.grasps.grasp_set import GraspSet
from dmfc.hand.description import HandDescription
from dmfc.hand.model import HandModel
from dmfc.objects.model import ObjectModel

SUFFIX = ".npy"
_KEYS = ("obj_pose", "obj_scale", "grasp_qpos")


def read(paths: Sequence[Path], model: ObjectModel) -> ForeignGrasps:
    """One grasp per file, in the frame of `model`.

    Raises DmfcError if a file is something else, or of an object of another size.
    """
    centre, size = _box(model)
    poses, joints = [], []
    for path in paths:
        grasp = _grasp(path)
        scale = float(grasp["obj_scale"])
        if not np.isclose(scale, size, rtol=0.01):
            raise DmfcError(
                f"{path}: obj_scale {scale:.4f}, but half the diagonal of '{model.id}' is "
                f"{size:.4f} m: another object or size (option --object)"
            )
        pose = inverse(_pose(grasp["obj_pose"])) @ _pose(grasp["grasp_qpos"])
        pose[:3, 3] += centre
        poses.append(pose)
        joints.append(np.asarray(grasp["grasp_qpos"], dtype=np.float64)[7:])
        if len(joints[-1]) != len(joints[0]):
            raise DmfcError(f"{path}: {len(joints[-1])} joints, but {len(joints[0])} before")
    return ForeignGrasps(np.stack(poses), np.stack(joints), [str(path) for path in paths])


def write(
    grasps: GraspSet,
    hand_map: HandMap,
    hand: HandModel,
    description: HandDescription,
    model: ObjectModel,
    folder: Path,
) -> int:
    """Write `folder/objects/NAME` and `folder/grasps/NAME/N.npy`; returns the number of grasps.

    The pre-grasp is our open hand at the same pose, the squeeze what our fingers are commanded.
    """
    name = model.id.replace("/", "__")
    centre, scale = _box(model)
    object_folder = (folder / "objects" / name).resolve()
    _write_object(model, centre, scale, object_folder)
    T_object_root = grasps.T_object_palm @ inverse(hand_map.T_root_palm)
    T_object_root[:, :3, 3] -= centre
    matrix = hand_map.matrix(description)
    (folder / "grasps" / name).mkdir(parents=True, exist_ok=True)
    for number, (T, joints) in enumerate(zip(T_object_root, grasps.joints, strict=True)):
        quaternion = Rotation.from_matrix(T[:3, :3]).as_quat(canonical=True, scalar_first=True)
        root = np.concatenate([T[:3, 3], quaternion])
        angles = {
            "pregrasp_qpos": hand.opened(joints),
            "grasp_qpos": joints,
            "squeeze_qpos": hand.squeezed(joints),
        }
        grasp: dict[str, Any] = {
            key: np.concatenate([root, matrix @ value]) for key, value in angles.items()
        }
        grasp["obj_pose"] = np.array([0.0, 0, 0, 1, 0, 0, 0])
        grasp["obj_scale"] = scale
        grasp["obj_path"] = str(object_folder)
        entry = np.empty((), dtype=object)
        entry[()] = grasp
        np.save(folder / "grasps" / name / f"{number}.npy", entry, allow_pickle=True)
    return len(grasps)


def _write_object(model: ObjectModel, centre: np.ndarray, scale: float, folder: Path) -> None:
    """The convex parts, and `simplified.json`: at density 1 the mass is the volume."""
    (folder / "urdf" / "meshes").mkdir(parents=True, exist_ok=True)
    (folder / "info").mkdir(exist_ok=True)
    volume = 0.0
    for number, vertices in enumerate(model.convex_parts):
        hull = trimesh.convex.convex_hull((vertices - centre) / scale)
        volume += float(hull.volume)
        hull.export(folder / "urdf" / "meshes" / f"convex_piece_{number:03d}.obj")
    info = {
        "gravity_center": ((model.com - centre) / scale).tolist(),
        "scale": 1.0,
        "density": 1.0,
        "mass": volume,
    }
    (folder / "info" / "simplified.json").write_text(json.dumps(info, indent=1))


def _box(model: ObjectModel) -> tuple[np.ndarray, float]:
    """Centre of the bounding box [3] and half its diagonal, metres."""
    low, high = model.vertices.min(0), model.vertices.max(0)
    return (low + high) / 2, float(np.linalg.norm(high - low) / 2)


def _grasp(path: Path) -> dict[str, Any]:
    found = load_objects(path)
    grasp = found[0] if len(found) == 1 else None
    if not isinstance(grasp, dict) or any(key not in grasp for key in _KEYS):
        raise DmfcError(f"{path}: not a grasp of DexGraspBench (a dict with {', '.join(_KEYS)})")
    if np.shape(grasp["obj_pose"]) != (7,) or np.ndim(grasp["grasp_qpos"]) != 1:
        raise DmfcError(f"{path}: obj_pose must have 7 numbers and grasp_qpos one row")
    return grasp


def _pose(qpos: Any) -> np.ndarray:
    """[4, 4] from x y z, w x y z and what follows."""
    values = np.asarray(qpos, dtype=np.float64)[:7]
    return transform(Rotation.from_quat(values[3:], scalar_first=True).as_matrix(), values[:3])
