"""DexGraspBench: one dict per `.npy` file, and a folder per object, read and written.

Its object frame is that of its meshes: they lie about the centre of their bounding box, of which
half the diagonal is their unit, and `obj_scale` is this half-diagonal in metres. `pregrasp_qpos`,
`grasp_qpos` and `squeeze_qpos` hold the root's pose in the world (xyz, wxyz) and the joint angles.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

from dmfc.errors import DmfcError
from dmfc.geometry.transforms import inverse
from dmfc.grasps.exchange.foreign import ForeignGrasps, numbers, pose, size
from dmfc.grasps.exchange.hand_map import HandMap
from dmfc.grasps.exchange.objects_file import load_objects
from dmfc.grasps.grasp_set import GraspSet
from dmfc.hand.description import HandDescription
from dmfc.hand.model import HandModel
from dmfc.objects.model import ObjectModel

SUFFIX = ".npy"
_TOLERANCE = 0.03
"""Share by which half a diagonal may differ from the scale: their simplified meshes are up to 1.6 %
larger than the normalised ones."""
_OFF_CENTRE = 0.02
"""Of half the diagonal: how far the box of their simplified meshes may lie from the origin."""
_KEYS = ("obj_pose", "obj_scale", "grasp_qpos")


def read(paths: Sequence[Path]) -> ForeignGrasps:
    """One grasp per file, in the frame of their mesh times the scale.

    Raises DmfcError if a file is something else.
    """
    poses, joints, scales = [], [], []
    for path in paths:
        grasp = _grasp(path)
        scales.append(size(grasp["obj_scale"], str(path), "obj_scale"))
        root = numbers(grasp["grasp_qpos"], None, str(path), "grasp_qpos")
        if len(root) < 7:
            raise DmfcError(f"{path}: grasp_qpos has {len(root)} numbers, not 7 and the joints'")
        T_world_object = _pose(numbers(grasp["obj_pose"], 7, str(path), "obj_pose"), path)
        poses.append(inverse(T_world_object) @ _pose(root, path))
        joints.append(root[7:])
        if len(joints[-1]) != len(joints[0]):
            raise DmfcError(f"{path}: {len(joints[-1])} joints, but {len(joints[0])} before")
    where = [str(path) for path in paths]
    return ForeignGrasps.of(np.stack(poses), np.stack(joints), where, scales)


def in_frame(foreign: ForeignGrasps, model: ObjectModel) -> ForeignGrasps:
    """The grasps in the frame of `model`. Raises DmfcError where it has another size."""
    centre, half = _frame(model)
    scale = float(foreign.scales[0])
    if abs(half / scale - 1) > _TOLERANCE:
        raise DmfcError(
            f"{foreign.where[0]}: obj_scale {scale:.4f}, but half the diagonal of '{model.id}' is "
            f"{half:.4f} m: another object or size (option --object; a mesh in metres takes "
            "?unit=m)"
        )
    return dataclasses.replace(foreign, position=foreign.position + centre)


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
    centre, scale = _frame(model)
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


def _frame(model: ObjectModel) -> tuple[np.ndarray, float]:
    """Origin of their frame in ours [3], and half the diagonal of the bounding box, metres.

    Their origin is the centre of the box of the mesh that they normalised. Of a mesh of the user's
    own that lies about its origin it is this origin: such are their meshes, simplified since.
    """
    low, high = model.vertices.min(0), model.vertices.max(0)
    centre, half = (low + high) / 2, float(np.linalg.norm(high - low) / 2)
    theirs = model.source == "folder" and np.linalg.norm(centre) < _OFF_CENTRE * half
    return (np.zeros(3) if theirs else centre), half


def _grasp(path: Path) -> dict[str, Any]:
    found = load_objects(path)
    grasp = found[0] if len(found) == 1 else None
    if not isinstance(grasp, dict) or any(key not in grasp for key in _KEYS):
        raise DmfcError(f"{path}: not a grasp of DexGraspBench (a dict with {', '.join(_KEYS)})")
    return grasp


def _pose(qpos: np.ndarray, path: Path) -> np.ndarray:
    """[4, 4] from x y z, w x y z and what follows."""
    return pose(qpos[:3], qpos[3:7], str(path), "a pose")
