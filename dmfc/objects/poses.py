"""Quasi-stable poses on a table."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import trimesh

_MERGE_ANGLE = np.deg2rad(10.0)
"""Poses whose downward directions differ by less are one pose."""


@dataclass(frozen=True)
class StablePoses:
    """k poses, the most probable first; see `ObjectModel`."""

    rotations: np.ndarray
    heights: np.ndarray
    probabilities: np.ndarray
    standard: int


def stable_poses(
    vertices: np.ndarray, parts: list[np.ndarray], com: np.ndarray, count: int
) -> StablePoses:
    """The `count` most probable poses in which the object rests on a plane.

    vertices [V, 3] of the mesh and the hulls of its convex parts (what the simulator will rest it
    on); com [3]. The pose that is closest to the mesh's own upright frame is always among them.
    """
    support = np.concatenate(parts)
    downs, probabilities = _resting_directions(support, com)
    chosen, weights = _merged(downs, probabilities)
    upright = int(np.argmin(chosen[:, 2]))
    kept = list(range(min(count, len(chosen))))
    if upright not in kept:
        kept[-1] = upright
    rotations = np.stack([_turn_down(down) for down in chosen[kept]])
    everything = np.concatenate([support, vertices])
    heights = np.array([-(everything @ rotation[2]).min() for rotation in rotations])
    return StablePoses(rotations, heights, weights[kept] / weights[kept].sum(), kept.index(upright))


def _resting_directions(support: np.ndarray, com: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(directions that point down in the object frame [n, 3], probabilities [n])."""
    hull = trimesh.convex.convex_hull(support)
    transforms, probabilities = trimesh.poses.compute_stable_poses(
        hull, center_mass=com, sigma=0.0, n_samples=1, threshold=0.0
    )
    probabilities = np.asarray(probabilities, dtype=np.float64)
    found = probabilities > 1e-6
    if not found.any():
        return np.array([[0.0, 0.0, -1.0]]), np.ones(1)
    return -np.asarray(transforms)[found, 2, :3], probabilities[found]


def _merged(downs: np.ndarray, probabilities: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Directions at least the merging angle apart, each with the sum of its class; sorted."""
    chosen: list[np.ndarray] = []
    weights: list[float] = []
    for index in np.argsort(-probabilities, kind="stable"):
        near = [float(downs[index] @ other) for other in chosen]
        if near and max(near) > np.cos(_MERGE_ANGLE):
            weights[int(np.argmax(near))] += probabilities[index]
        else:
            chosen.append(downs[index])
            weights.append(float(probabilities[index]))
    order = np.argsort(-np.array(weights), kind="stable")
    return np.array(chosen)[order], np.array(weights)[order]


def _turn_down(down: np.ndarray) -> np.ndarray:
    """The smallest rotation R [3, 3] with R @ down = (0, 0, -1) (Rodrigues' formula)."""
    down = down / np.linalg.norm(down)
    axis = np.cross(down, [0.0, 0.0, -1.0])
    sine, cosine = np.linalg.norm(axis), -down[2]
    if sine < 1e-9:
        return np.eye(3) if cosine > 0 else np.diag([1.0, -1.0, -1.0])
    x, y, z = axis / sine
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + sine * cross + (1 - cosine) * cross @ cross
