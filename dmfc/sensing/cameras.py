"""Four pinhole cameras, one per side of the table, all looking at its centre.

Camera frame: x right, y down, z forward (the depth). Pixel (row, column) has its centre at
(column + 0.5, row + 0.5); p_camera = depth * ((u - cx) / f, (v - cy) / f, 1).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from dmfc.config.scenes import CameraConfig
from dmfc.errors import DmfcError

SIDES = 4


@dataclass(frozen=True)
class Camera:
    """A pinhole camera with square pixels and its principal point in the middle."""

    T_world_camera: np.ndarray
    """[4, 4]."""
    width: int
    height: int
    focal: float
    """Pixels."""
    fov_y: float
    """Vertical field of view, rad."""

    @property
    def position(self) -> np.ndarray:
        """[3], world frame."""
        return self.T_world_camera[:3, 3]

    def rays(self, rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
        """World directions [n, 3] of pixels [n], scaled so that position + depth * ray is the point
        at that depth."""
        return self.grid[rows, columns] @ self.T_world_camera[:3, :3].T

    @cached_property
    def grid(self) -> np.ndarray:
        """[H, W, 3] directions of all pixels in the camera frame, of depth 1."""
        y, x = np.indices((self.height, self.width)) + 0.5
        x, y = (x - self.width / 2) / self.focal, (y - self.height / 2) / self.focal
        return np.stack([x, y, np.ones_like(x)], axis=-1)

    def project(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Image coordinates (u right, v down) [..., 2], pixels, and depth [...] of world points."""
        local = (points - self.position) @ self.T_world_camera[:3, :3]
        scaled = self.focal * local[..., :2] / local[..., 2:]
        return scaled + np.array([self.width, self.height]) / 2, local[..., 2]


def table_cameras(config: CameraConfig) -> list[Camera]:
    """The cameras on the +x, +y, -x and -y sides, in this order.

    Raises DmfcError for a size, angle or distance that no camera can have.
    """
    if min(config.width, config.height) < 1 or config.distance <= 0:
        raise DmfcError(
            f"no camera of {config.width} x {config.height} pixels at {config.distance} m "
            "(settings scenes.cameras.width, height, distance)"
        )
    if not 0 < config.fov_y < np.pi or not 0 <= config.elevation < np.pi / 2:
        raise DmfcError(
            f"field of view {config.fov_y} rad or elevation {config.elevation} rad is out of range "
            "(settings scenes.cameras.fov_y, elevation)"
        )
    focal = config.height / (2 * np.tan(config.fov_y / 2))
    target = np.array([0.0, 0.0, config.target_height])
    cameras = []
    for azimuth in np.arange(SIDES) * 2 * np.pi / SIDES:
        flat = np.cos(config.elevation) * np.array([np.cos(azimuth), np.sin(azimuth), 0])
        back = flat + np.array([0, 0, np.sin(config.elevation)])
        right = np.array([-np.sin(azimuth), np.cos(azimuth), 0])
        T_world_camera = np.eye(4)
        T_world_camera[:3, :3] = np.stack([right, np.cross(-back, right), -back], axis=1)
        T_world_camera[:3, 3] = target + config.distance * back
        cameras.append(Camera(T_world_camera, config.width, config.height, focal, config.fov_y))
    return cameras
