"""Depth images of a scene as they are kept: the pixels of its objects, a few bytes each.

The rest of an image is the empty table, known in closed form. Depths are kept as 16-bit multiples
of a quantum per scene (about 0.01 mm), normals as 8-bit fractions (0.5 degrees).
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
import pyarrow as pa

from dmfc.sensing.cameras import Camera
from dmfc.sensing.render import View, table_view

_CODEC = "zstd"
_DEPTHS, _FRACTIONS = 65535, 127  # of 16 bits without sign, of 8 bits with one


@dataclass(frozen=True)
class ObjectPixels:
    """The M pixels of all cameras that show an object: camera after camera, row after row."""

    camera: np.ndarray
    """[M] index of the camera."""
    row: np.ndarray
    column: np.ndarray
    depth: np.ndarray
    """[M] float32, metres along the camera's z axis."""
    object_index: np.ndarray
    """[M] index of the object in the scene."""
    face: np.ndarray
    """[M] triangle of the object; -1 where it is not known."""

    def __len__(self) -> int:
        return len(self.camera)

    def __getitem__(self, chosen: np.ndarray) -> ObjectPixels:
        return ObjectPixels(*(getattr(self, entry.name)[chosen] for entry in fields(self)))

    def points(self, cameras: Sequence[Camera]) -> tuple[np.ndarray, np.ndarray]:
        """World points and the vectors from them towards their camera (unit depth): [M, 3] each."""
        points, towards = np.empty((len(self), 3)), np.empty((len(self), 3))
        for number, camera in enumerate(cameras):
            mine = self.camera == number
            rays = camera.rays(self.row[mine], self.column[mine])
            points[mine] = camera.position + self.depth[mine, None].astype(np.float64) * rays
            towards[mine] = -rays
        return points, towards


def object_pixels(views: Sequence[View]) -> ObjectPixels:
    """The pixels that show an object."""
    parts = []
    for number, view in enumerate(views):
        place = np.nonzero(view.object_index >= 0)
        unknown = np.full(len(place[0]), -1)
        face = unknown if view.face is None else view.face[place]
        camera = np.full(len(place[0]), number)
        parts.append((camera, *place, view.depth[place], view.object_index[place], face))
    return ObjectPixels(*(np.concatenate(values) for values in zip(*parts, strict=True)))


def encode(pixels: ObjectPixels, normals: np.ndarray, height: int, width: int) -> bytes:
    """Pixels of images of that size, with their world normals [M, 3], as bytes."""
    place = (pixels.camera * height + pixels.row) * width + pixels.column
    starts = np.flatnonzero(np.diff(place, prepend=-2) != 1)
    runs = np.diff(starts, append=len(place))
    low = float(pixels.depth.min())
    quantum = max((float(pixels.depth.max()) - low) / _DEPTHS, 1e-9)
    depth = np.rint((pixels.depth.astype(np.float64) - low) / quantum).astype(np.uint16)
    arrays = [
        place[starts].astype(np.uint32),
        runs.astype(np.uint32),
        np.diff(depth, prepend=depth[:1]),  # steps are small: two in three bytes are alike
        pixels.object_index.astype(np.uint8),
        np.rint(normals.T * _FRACTIONS).astype(np.int8),
    ]
    header = {"runs": len(runs), "pixels": len(pixels), "low": low, "quantum": quantum}
    header |= {"first": int(depth[0]), "height": height, "width": width}
    planes = [_planes(array) for array in arrays]
    raw = json.dumps(header).encode() + b"\n" + b"".join(planes)
    packed = pa.compress(raw, codec=_CODEC, asbytes=True)
    return len(raw).to_bytes(4, "little") + packed


def decode(data: bytes) -> tuple[ObjectPixels, np.ndarray]:
    """What `encode` was given: pixels (their faces unknown) and normals [M, 3]."""
    size = int.from_bytes(data[:4], "little")
    raw = pa.decompress(data[4:], decompressed_size=size, codec=_CODEC, asbytes=True)
    end = raw.index(b"\n") + 1
    header = json.loads(raw[:end])
    runs, count = header["runs"], header["pixels"]
    taken = end

    def take(kind: type[np.generic], number: int) -> np.ndarray:
        nonlocal taken
        size = np.dtype(kind).itemsize * number
        planes = np.frombuffer(raw, np.uint8, size, taken).reshape(-1, number)
        taken += size
        return np.ascontiguousarray(planes.T).view(kind)[:, 0]

    starts, lengths = (take(np.uint32, runs).astype(np.int64) for _ in range(2))
    before = np.cumsum(lengths) - lengths
    place = np.arange(count) + np.repeat(starts - before, lengths)
    steps = take(np.uint16, count)
    depth = header["first"] + np.cumsum(steps, dtype=np.uint16)
    index = take(np.uint8, count)
    normals = np.stack([take(np.int8, count) for _ in range(3)], axis=1).astype(np.float32)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-9)
    row, column = np.divmod(place, header["width"])
    camera, row = np.divmod(row, header["height"])
    metres = (header["low"] + header["quantum"] * depth.astype(np.float64)).astype(np.float32)
    return ObjectPixels(camera, row, column, metres, index, np.full(count, -1)), normals


def views_of(pixels: ObjectPixels, cameras: Sequence[Camera], table_size: float) -> list[View]:
    """The whole depth images again: the pixels on the empty table."""
    views = []
    for number, camera in enumerate(cameras):
        mine = pixels.camera == number
        place = pixels.row[mine], pixels.column[mine]
        view = table_view(camera, table_size)
        view.depth[place] = pixels.depth[mine]
        view.object_index[place] = pixels.object_index[mine]
        views.append(view)
    return views


def _planes(array: np.ndarray) -> bytes:
    """The first byte of all numbers, then the second, ...: what is alike lies together."""
    flat = np.ascontiguousarray(array).reshape(-1, 1)
    return flat.view(np.uint8).T.tobytes()
