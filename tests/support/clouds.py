"""Clouds and depth images of meshes as a camera sees them, by ray casting alone."""

from __future__ import annotations

import numpy as np
import trimesh

from dmfc.config.scenes import CameraConfig
from dmfc.sensing.cameras import Camera, table_cameras

CAMERAS = table_cameras(CameraConfig())
TABLE = trimesh.creation.box((0.6, 0.6, 0.02)).apply_translation([0, 0, -0.01])


def blob() -> np.ndarray:
    """[3000, 3] a lumpy surface on the table, off the origin."""
    generator = np.random.default_rng(1)
    direction = generator.normal(size=(3000, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    return direction * [0.03, 0.04, 0.06] + [0.1, -0.2, 0.06]


def standing(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    """The mesh with its lowest point on z = 0 and its box centred about the z axis."""
    low, high = mesh.bounds
    moved = mesh.copy()
    moved.apply_translation([*(-(low + high)[:2] / 2), -low[2]])
    return moved


def box(size: tuple[float, float, float] = (0.05, 0.07, 0.12)) -> trimesh.Trimesh:
    return standing(trimesh.creation.box(size))


def depth_image(mesh: trimesh.Trimesh, camera: Camera) -> np.ndarray:
    """[H, W] metres along the camera's axis, 0 where nothing is hit."""
    directions = (camera.grid @ camera.T_world_camera[:3, :3].T).reshape(-1, 3)
    origins = np.tile(camera.position, (len(directions), 1))
    hits, ray, _ = mesh.ray.intersects_location(origins, directions, multiple_hits=False)
    depth = np.zeros(len(directions))
    depth[ray] = (hits - camera.position) @ camera.T_world_camera[:3, 2]
    return depth.reshape(camera.grid.shape[:2])


def cloud(mesh: trimesh.Trimesh, noise: float = 0.0, stride: int = 3) -> np.ndarray:
    """[N, 3] what the four cameras see of it, every `stride`-th pixel; noise along the ray."""
    generator = np.random.default_rng(0)
    seen = []
    for camera in CAMERAS:
        depth = depth_image(mesh, camera)
        rows, columns = np.nonzero(depth)
        d = depth[rows, columns] + noise * generator.standard_normal(len(rows))
        points = camera.position + d[:, None] * camera.rays(rows, columns)
        seen.append(points[::stride])
    return np.concatenate(seen)


def box_on_table() -> trimesh.Trimesh:
    return trimesh.util.concatenate([box(), TABLE])
