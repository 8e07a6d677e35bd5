"""Clouds in files: PLY, PCD, NPY, NPZ and text, each as an array [N, 3] in the file's own unit."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from dmfc.errors import DmfcError, unknown_name
from dmfc.files.foreign import reading

AXES = ("x", "y", "z")


def read_cloud(path: Path) -> np.ndarray:
    """The points [N, 3] of a file, in its order, numbers as they are stored, NaN where it has them.

    Raises DmfcError where the file is missing, of an unknown format, damaged, or no cloud.
    """
    suffix = path.suffix.lower()
    if suffix not in READERS:
        known = ", ".join([*READERS, "and with --intrinsics a depth image: .png, .npy"])
        raise DmfcError(f"{path}: unknown format of a cloud (known: {known})")
    with reading(path, f"a cloud ({suffix[1:]})"):
        return READERS[suffix](path)


def load_array(path: Path) -> np.ndarray:
    """The array of an .npy file, without pickled objects."""
    array: Any = np.load(path, allow_pickle=False)
    if not isinstance(array, np.ndarray):
        raise DmfcError(f"{path} holds several arrays: name the file .npz")
    return array


def _ply(path: Path) -> np.ndarray:
    from plyfile import PlyData

    content = PlyData.read(path, mmap=False)
    counts = {element.name: element.count for element in content.elements}
    if counts.get("face"):
        raise DmfcError(
            f"{path} is a mesh of {counts['face']} faces, not a cloud: sample points on what a "
            "camera sees of it, for example with trimesh.sample.sample_surface"
        )
    if "vertex" not in counts:
        raise DmfcError(f"{path} has the elements {', '.join(counts) or 'none'}, not vertex")
    return _fields(content["vertex"].data, path)


def _pcd(path: Path) -> np.ndarray:
    from pydantic import ValidationError
    from pypcd4 import PointCloud

    try:
        cloud = PointCloud.from_path(path)
    except ValidationError as error:
        wrong = [f"{'.'.join(map(str, e['loc']))}: {e['msg']}" for e in error.errors()]
        raise DmfcError(f"{path}: its header is not a PCD header ({'; '.join(wrong)})") from error
    rows = np.atleast_1d(cloud.pc_data)
    if len(rows) != cloud.points:
        raise DmfcError(f"{path} holds {len(rows)} points, not the {cloud.points} it promises")
    return _fields(rows, path)


def _npy(path: Path) -> np.ndarray:
    return _rows(load_array(path), path)


def _npz(path: Path) -> np.ndarray:
    arrays: Any = np.load(path, allow_pickle=False)
    if isinstance(arrays, np.ndarray):
        raise DmfcError(f"{path} holds one array: name the file .npy")
    with arrays:
        names = list(arrays)
        if "points" not in names and len(names) != 1:
            raise unknown_name(f"array in {path}", "points", names)
        return _rows(arrays["points" if "points" in names else names[0]], path)


def _text(path: Path) -> np.ndarray:
    values = np.loadtxt(path, delimiter="," if path.suffix.lower() == ".csv" else None, ndmin=2)
    if not len(values) or values.shape[1] < 3:
        raise DmfcError(f"{path} holds {list(values.shape)} numbers, not points x y z per line")
    return values[:, :3]


def _rows(array: np.ndarray, path: Path) -> np.ndarray:
    """Of an array [N, 3], of the [H, W, 3] of an organised cloud, or of named fields."""
    if array.dtype.names:
        return _fields(array.ravel(), path)
    if array.ndim == 3 and array.shape[2] == 3:
        array = array.reshape(-1, 3)
    if array.ndim != 2 or array.shape[1] != 3 or array.dtype.kind not in "fiu":
        hint = "; for a depth image give --intrinsics" if array.ndim == 2 else ""
        raise DmfcError(f"{path} holds {array.dtype} {list(array.shape)}, a cloud is [N, 3]{hint}")
    return array


def _fields(rows: np.ndarray, path: Path) -> np.ndarray:
    """Of rows [N] with named fields, such as PCL's and ROS's; names in either case."""
    names = rows.dtype.names or ()
    known = {name.lower(): name for name in names} | {name: name for name in names}
    found = [rows[known[axis]] for axis in AXES if axis in known]
    if len(found) != 3 or any(part.ndim != 1 or part.dtype.kind not in "fiu" for part in found):
        raise DmfcError(f"{path} has the fields {' '.join(names)}, not the numbers x, y and z")
    return np.stack(found, axis=1)


READERS: dict[str, Callable[[Path], np.ndarray]] = {
    ".ply": _ply,
    ".pcd": _pcd,
    ".npy": _npy,
    ".npz": _npz,
    ".xyz": _text,
    ".txt": _text,
    ".csv": _text,
}
