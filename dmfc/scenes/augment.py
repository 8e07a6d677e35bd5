"""Errors of the depth cameras, and random motions of a scene; what the loader adds to its data."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from dmfc.config.scenes import AugmentationConfig, PointErrorsConfig


def sensor_errors(
    config: PointErrorsConfig,
    points: np.ndarray,
    normals: np.ndarray,
    point_camera: np.ndarray,
    camera_positions: np.ndarray,
    generator: np.random.Generator,
) -> tuple[np.ndarray, np.ndarray]:
    """Points and normals [N, 3] as cameras with errors of depth and of their own pose see them.

    point_camera: [N] index into camera_positions [C, 3]; all in one frame. None is lost here: see
    `kept_points`.
    """
    centre = camera_positions[point_camera]
    points = points + depth_noise(config, points - centre, generator)
    points = in_steps(config, points, centre)
    if config.camera_turn == 0 and config.camera_shift == 0:
        return points, normals
    count = len(camera_positions)
    vector = config.camera_turn * generator.standard_normal((count, 3))
    turned = Rotation.from_rotvec(vector).as_matrix()[point_camera]
    shift = config.camera_shift * generator.standard_normal((count, 3))
    points = centre + shift[point_camera] + np.einsum("nij,nj->ni", turned, points - centre)
    return points, np.einsum("nij,nj->ni", turned, normals)


def depth_noise(
    config: PointErrorsConfig, rays: np.ndarray, generator: np.random.Generator
) -> np.ndarray:
    """Gaussian error of depth along the rays [N, 3] from the camera: [N, 3], metres."""
    length = np.linalg.norm(rays, axis=1, keepdims=True)
    return config.noise * generator.standard_normal((len(rays), 1)) * rays / length


def in_steps(config: PointErrorsConfig, points: np.ndarray, centre: np.ndarray) -> np.ndarray:
    """Points [N, 3] whose distance from their camera `centre` [N, 3] is a multiple of `quantum`."""
    if config.quantum == 0:
        return points
    ray = points - centre
    length = np.linalg.norm(ray, axis=1, keepdims=True)
    return centre + ray * np.rint(length / config.quantum) * config.quantum / length


def kept_points(
    config: PointErrorsConfig, count: int, generator: np.random.Generator
) -> np.ndarray:
    """Indices [N] in random order, where the dropped ones are replaced by repeats of others.

    The order is random in every epoch, so that the seed points, which begin at point 0, differ too.
    """
    order = generator.permutation(count)
    lost = min(int(config.dropped * count), count - 1)
    kept = order[: count - lost]
    return np.concatenate([kept, generator.choice(kept, lost)])


def random_motion(config: AugmentationConfig, generator: np.random.Generator) -> np.ndarray:
    """T_new_world [4, 4]: a turn about the vertical through the table centre, and a shift."""
    yaw = generator.uniform(-np.pi, np.pi) if config.yaw else 0.0
    T = np.eye(4)
    T[:2, :2] = [[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]]
    T[:2, 3] = generator.uniform(-config.shift, config.shift, 2)
    return T
