"""A depth image with intrinsics and a mask as a cloud in the frame of its camera.

Camera frame: x right, y down, z forward, as OpenCV and ROS have it; pixel (row, column) has its
centre at (column, row), so p = depth * ((column - cx) / fx, (row - cy) / fy, 1).
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dmfc.errors import DmfcError
from dmfc.prediction.read_cloud import load_array

SUFFIXES = (".png", ".npy")


@dataclass(frozen=True)
class Intrinsics:
    """Of a pinhole camera without distortion, pixels."""

    fx: float
    fy: float
    cx: float
    cy: float

    @classmethod
    def parse(cls, text: str) -> Intrinsics:
        """'fx,fy,cx,cy'."""
        try:
            found = cls(*(float(word) for word in text.split(",")))
        except (TypeError, ValueError):
            raise DmfcError(f"--intrinsics wants fx,fy,cx,cy in pixels, not '{text}'") from None
        if not (found.fx > 0 and found.fy > 0):
            raise DmfcError(f"--intrinsics {text}: fx and fy are positive")
        return found


def read_image(path: Path) -> np.ndarray:
    """The numbers [H, W] of a PNG (16 bits for depth) or an NPY file."""
    if not path.is_file():
        raise DmfcError(f"there is no file '{path}'")
    if path.suffix.lower() not in SUFFIXES:
        raise DmfcError(f"{path.name}: unknown format of an image (known: {', '.join(SUFFIXES)})")
    try:
        if path.suffix.lower() == ".npy":
            image = load_array(path)
        else:
            from PIL import Image

            with Image.open(path) as opened:
                image = np.asarray(opened)
    except (OSError, ValueError) as error:
        raise DmfcError(f"{path.name} cannot be read: {' '.join(str(error).split())}") from error
    if image.ndim != 2:
        raise DmfcError(f"{path.name} is {list(image.shape)}: an image has one number per pixel")
    return image


def depth_unit(depth: np.ndarray) -> str:
    """Unit that depth has by custom: whole numbers are millimetres, others metres."""
    return "mm" if depth.dtype.kind in "iu" else "m"


def cloud_of_depth(
    depth: np.ndarray, intrinsics: Intrinsics, mask: np.ndarray | None = None
) -> np.ndarray:
    """Points [N, 3] of the pixels of `depth` [H, W] that have one, in its unit, camera frame.

    `mask` [H, W]: other than 0 at the objects. Depths of 0, NaN and infinity are pixels without an
    answer. Raises DmfcError where the mask has another size.
    """
    seen = np.isfinite(depth) & (depth > 0)
    if mask is not None:
        if mask.shape != depth.shape:
            raise DmfcError(
                f"the mask is {mask.shape[1]} x {mask.shape[0]} pixels, the depth image "
                f"{depth.shape[1]} x {depth.shape[0]} (--mask)"
            )
        seen &= mask != 0
    row, column = np.nonzero(seen)
    z = depth[row, column].astype(np.float64)
    x = (column - intrinsics.cx) / intrinsics.fx
    y = (row - intrinsics.cy) / intrinsics.fy
    return np.stack([z * x, z * y, z], axis=1)


def read_pose(path: Path) -> np.ndarray:
    """T_world_camera [4, 4] of a file: .npy, or text of 16 numbers, row by row.

    Raises DmfcError where it is no rotation and translation.
    """
    if not path.is_file():
        raise DmfcError(f"there is no file '{path}' (--pose)")
    try:
        found = load_array(path) if path.suffix.lower() == ".npy" else np.loadtxt(path, ndmin=2)
        T = np.asarray(found, dtype=np.float64).reshape(4, 4)
    except (OSError, ValueError) as error:
        raise DmfcError(
            f"{path.name} is no 4 x 4 matrix: {' '.join(str(error).split())} (--pose)"
        ) from error
    rigid = np.allclose(T[:3, :3] @ T[:3, :3].T, np.eye(3), atol=1e-3) and np.allclose(
        T[3], [0, 0, 0, 1]
    )
    if not rigid or np.linalg.det(T[:3, :3]) < 0:
        raise DmfcError(f"{path.name} is no pose: a rotation and a translation in metres (--pose)")
    return T
