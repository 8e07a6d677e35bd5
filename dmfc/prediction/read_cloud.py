"""Clouds in files: PLY, PCD, NPY, NPZ, each as an array [N, 3] in the file's own unit."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np

from dmfc.errors import DmfcError, one_line, unknown_name
from dmfc.prediction.pcd import read_pcd


def read_cloud(path: Path) -> np.ndarray:
    """The points [N, 3] of a file, float64, NaN where it has them.

    Raises DmfcError where the file is missing, of an unknown format, damaged, or no cloud.
    """
    if not path.is_file():
        raise DmfcError(f"there is no file '{path}'")
    if path.suffix.lower() not in READERS:
        known = ", ".join([*READERS, "and with --intrinsics a depth image: .png, .npy"])
        raise DmfcError(f"{path.name}: unknown format of a cloud (known: {known})")
    try:
        return READERS[path.suffix.lower()](path)
    except (OSError, ValueError, KeyError, IndexError, BadZipFile) as error:
        text = one_line(error)
        raise DmfcError(f"{path.name} cannot be read as {path.suffix[1:]}: {text}") from error


def load_array(path: Path) -> np.ndarray:
    """The array of an .npy file, without pickled objects."""
    array: Any = np.load(path, allow_pickle=False)
    if not isinstance(array, np.ndarray):
        raise ValueError("it holds several arrays; name the file .npz")
    return array


def _ply(path: Path) -> np.ndarray:
    from trimesh.exchange.ply import load_ply

    with open(path, "rb") as file:
        content = load_ply(file)
    faces = content.get("faces")
    if faces is not None and len(faces):
        raise DmfcError(
            f"{path.name} is a mesh of {len(faces)} faces, not a cloud: sample points on what a "
            "camera sees of it, for example with trimesh.sample.sample_surface"
        )
    return np.asarray(content["vertices"], dtype=np.float64)


def _npy(path: Path) -> np.ndarray:
    return _rows(load_array(path), path)


def _npz(path: Path) -> np.ndarray:
    with np.load(path, allow_pickle=False) as arrays:
        names = list(arrays)
        if "points" not in names and len(names) != 1:
            raise unknown_name(f"array in {path.name}", "points", names)
        return _rows(arrays["points" if "points" in names else names[0]], path)


def _rows(array: np.ndarray, path: Path) -> np.ndarray:
    """[N, 3], or the [H, W, 3] of an organised cloud."""
    if array.ndim == 3 and array.shape[2] == 3:
        array = array.reshape(-1, 3)
    if array.ndim != 2 or array.shape[1] != 3 or array.dtype.kind not in "fiu":
        hint = "; for a depth image give --intrinsics" if array.ndim == 2 else ""
        raise DmfcError(
            f"{path.name} holds {array.dtype} {list(array.shape)}, a cloud is [N, 3]{hint}"
        )
    return array.astype(np.float64)


READERS: dict[str, Callable[[Path], np.ndarray]] = {
    ".ply": _ply,
    ".pcd": read_pcd,
    ".npy": _npy,
    ".npz": _npz,
}
