"""The pixels of depth images that show an object, and their points in the world."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from dmfc.sensing.cameras import Camera
from dmfc.sensing.render import CameraView


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


def object_pixels(views: Sequence[CameraView]) -> ObjectPixels:
    """The pixels that show an object."""
    parts = []
    for number, view in enumerate(views):
        place = np.nonzero(view.object_index >= 0)
        unknown = np.full(len(place[0]), -1)
        face = unknown if view.face is None else view.face[place]
        camera = np.full(len(place[0]), number)
        parts.append((camera, *place, view.depth[place], view.object_index[place], face))
    return ObjectPixels(*(np.concatenate(values) for values in zip(*parts, strict=True)))
