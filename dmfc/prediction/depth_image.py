"""A depth image with intrinsics and a mask as a cloud in the frame of its camera.

Camera frame: x right, y down, z forward, as OpenCV and ROS have it; pixel (row, column) has its
centre at (column, row), so p = depth * ((column - cx) / fx, (row - cy) / fy, 1).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dmfc.errors import DmfcError
from dmfc.files.foreign import reading
from dmfc.geometry.units import UNITS, metres
from dmfc.sensing.read_cloud import load_array

SUFFIXES = (".png", ".npy")
NEAREST, FARTHEST = 0.02, 10.0
"""Metres: no depth camera measures the objects of a table nearer or farther."""
USUAL = (0.1, 2.0)
"""Metres within which the objects are expected where nobody said the unit of the depth."""
OFF_CENTRE = 0.2
"""A principal point that is off the middle by a larger share of it, along both axes alike, is that
of another resolution."""


@dataclass(frozen=True)
class Intrinsics:
    """Of a pinhole camera without distortion, pixels."""

    fx: float
    fy: float
    cx: float
    cy: float

    @classmethod
    def parse(cls, text: str) -> Intrinsics:
        """'fx,fy,cx,cy'. Raises DmfcError where they are no such numbers."""
        try:
            found = cls(*(float(word) for word in text.split(",")))
        except (TypeError, ValueError):
            raise DmfcError(f"--intrinsics wants fx,fy,cx,cy in pixels, not '{text}'") from None
        numbers = (found.fx, found.fy, found.cx, found.cy)
        if not all(map(math.isfinite, numbers)) or not (found.fx > 0 and found.fy > 0):
            raise DmfcError(f"--intrinsics {text}: fx and fy are positive, and all are finite")
        if not 0.5 < found.fx / found.fy < 2:
            raise DmfcError(f"--intrinsics {text}: fx and fy of a camera are almost equal")
        return found

    def check(self, height: int, width: int) -> None:
        """Raises DmfcError where they are not those of an image of so many pixels."""
        given = f"--intrinsics: the principal point is ({self.cx:g}, {self.cy:g})"
        image = f"the image has {width} x {height} pixels"
        across, down = (2 * self.cx + 1) / width, (2 * self.cy + 1) / height
        off = min(abs(across - 1), abs(down - 1))
        if off > OFF_CENTRE and abs(across - down) < OFF_CENTRE / 2 * across:
            raise DmfcError(
                f"{given}, the middle of {2 * self.cx + 1:.0f} x {2 * self.cy + 1:.0f} pixels, and "
                f"{image}: give the intrinsics of this resolution"
            )
        if not (0 <= self.cx <= width - 1 and 0 <= self.cy <= height - 1):
            raise DmfcError(
                f"{given}, outside the image: {image}; for a part of an image give the whole one "
                "and --mask"
            )


def read_image(path: Path, option: str = "") -> np.ndarray:
    """The numbers [H, W] of a PNG or an NPY file. `option`: the one that named it, for errors."""
    hint = f" ({option})" if option else ""
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise DmfcError(f"{path}: unknown format of an image (known: {', '.join(SUFFIXES)}){hint}")
    with reading(path, f"an image ({suffix[1:]})", option):
        image = load_array(path) if suffix == ".npy" else _png(path)
    if image.ndim != 2 or image.dtype.kind not in "fiub" or not image.size:
        raise DmfcError(
            f"{path} is {image.dtype} {list(image.shape)}: an image has one number per pixel{hint}"
        )
    return image


def _png(path: Path) -> np.ndarray:
    from PIL import Image

    with Image.open(path, formats=["PNG"]) as opened:
        return np.asarray(opened)


def depth_in_metres(depth: np.ndarray, unit: str = "", scale: str = "") -> np.ndarray:
    """Depth [H, W] in metres, float64, NaN where the camera has no answer.

    `unit` of its numbers, or `scale`: metres that 1 stands for, such as 1/5000. By default whole
    numbers are millimetres, others metres. No answer: 0 and less, NaN, infinity, and the greatest
    number of 16 bits. Raises DmfcError for a picture of 8 bits, which holds no depth.
    """
    if unit and scale:
        raise DmfcError("--unit and --depth-scale say the same: give one of them")
    if depth.dtype.kind == "b" or depth.dtype.itemsize == 1:
        raise DmfcError(
            "the depth image has 8 bits per pixel, which hold no depth: save its numbers in 16 "
            "bits, not a picture of them"
        )
    whole = depth.dtype.kind in "iu"
    step = parse_scale(scale) if scale else metres(unit or ("mm" if whole else "m"))
    missing = ~(depth > 0) | ~np.isfinite(depth)
    if whole:
        missing |= depth == np.iinfo(np.uint16).max
    return np.where(missing, np.nan, depth * step)


def parse_scale(text: str) -> float:
    """'1/5000' or '0.0001', metres. Raises DmfcError where it is no such number."""
    above, _, below = text.partition("/")
    try:
        scale = float(above) / float(below or 1)
    except (ValueError, ZeroDivisionError):
        raise DmfcError(
            f"--depth-scale wants metres such as 1/5000 or 0.0001, not '{text}'"
        ) from None
    if not 0 < scale <= 1:
        hint = f": did you mean 1/{text}?" if scale > 1 else ""
        raise DmfcError(f"--depth-scale {text}: metres that 1 stands for, at most 1{hint}")
    return scale


def cloud_of_depth(
    depth: np.ndarray, intrinsics: Intrinsics, mask: np.ndarray | None = None
) -> np.ndarray:
    """Points [N, 3] of the pixels of `depth` [H, W] that have one, in its unit, camera frame.

    `mask` [H, W]: other than 0 at the objects. Depths of 0, NaN and infinity are pixels without an
    answer. Raises DmfcError where mask or intrinsics are those of another image.
    """
    intrinsics.check(*depth.shape)
    seen = np.isfinite(depth) & (depth > 0)
    if mask is not None:
        if mask.shape != depth.shape:
            raise DmfcError(
                f"the mask is {mask.shape[1]} x {mask.shape[0]} pixels, the depth image "
                f"{depth.shape[1]} x {depth.shape[0]} (--mask)"
            )
        seen &= (mask != 0) & ~np.isnan(mask.astype(np.float64))
    row, column = np.nonzero(seen)
    z = depth[row, column].astype(np.float64)
    x = (column - intrinsics.cx) / intrinsics.fx
    y = (row - intrinsics.cy) / intrinsics.fy
    return np.stack([z * x, z * y, z], axis=1)


def check_depth(points: np.ndarray, stated: str = "") -> None:
    """Raises DmfcError where points [N, 3] in metres, camera frame, are not before the camera.

    `stated`: what was said of the unit of the depth. Where nothing was, objects are expected as far
    away as usual.
    """
    if not len(points):
        raise DmfcError("no pixel of the mask has a depth (--mask)")
    away = float(np.median(points[:, 2]))
    lower, upper = (NEAREST, FARTHEST) if stated else USUAL
    if lower <= away <= upper:
        return
    read = f"the objects are {away:.3g} m from the camera (median)"
    if stated:
        raise DmfcError(f"{read} when the depth is read with {stated}: a depth camera sees none so")
    raise DmfcError(
        f"{read}, which is implausible: say what its numbers are (--depth-scale 1/5000, 0.0001; "
        f"--unit {', '.join(UNITS)}), or where the objects are (--mask)"
    )


def read_pose(path: Path) -> np.ndarray:
    """T_world_camera [4, 4] of a file: .npy, or text of 16 numbers, row by row.

    Raises DmfcError where it is no rotation and translation.
    """
    with reading(path, "a 4 x 4 matrix", "--pose"):
        found = load_array(path) if path.suffix.lower() == ".npy" else np.loadtxt(path, ndmin=2)
        T = np.asarray(found, dtype=np.float64).reshape(4, 4)
    rotation = T[:3, :3]
    rigid = (
        np.isfinite(T).all()
        and np.abs(rotation).max() < 2
        and np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-3)
        and np.allclose(T[3], [0, 0, 0, 1])
    )
    if not rigid or np.linalg.det(rotation) < 0:
        raise DmfcError(f"{path} is not a pose, a rotation and a translation in metres (--pose)")
    return T
