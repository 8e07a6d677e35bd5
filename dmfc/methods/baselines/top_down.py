"""A heuristic: from above, across the narrow side of each cluster of points, as deep as is clear.

No learning, no labels. The way in which the given hand closes follows from the normals of
its inside.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import torch
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from dmfc.config.execution import ExecutionConfig
from dmfc.hand.kinematics import HandKinematics
from dmfc.hand.model import HandModel
from dmfc.methods.observation import Observation
from dmfc.prediction.cloud_check import CloudCheck

GAP = 0.015
"""m between two points of one cluster."""
LEAST = 20
"""Points of a cluster."""
BENT = (0.5, 0.7, 0.9)
"""rad of flexion beyond the open hand."""
MOST = 8
"""Grasps of an answer."""
TURNS = np.deg2rad([0.0, -25.0, 25.0])
"""About the vertical, from across the narrow side."""
DEPTHS = np.arange(0.0, 0.081, 0.01)
"""m of the grip's middle below the top of the cluster."""
LOWEST = 0.015
"""m of the grip's middle above the table."""


def predict(seen: Observation) -> dict[str, Any]:
    """The clear grasps from above, the deepest first."""
    hand = seen.hand
    T, joints, depth = [], [], []
    for bent in BENT:
        posture = np.clip(hand.open_joints + bent * hand.flexion, hand.lower, hand.upper)
        middle, across = grip(hand, posture)
        for target, narrow, down in places(seen.points):
            for turn in (*TURNS, *(TURNS + np.pi)):
                pose = np.eye(4)
                pose[:3, :3] = _down(hand.palm_normal, across, narrow, turn)
                pose[:3, 3] = target - pose[:3, :3] @ middle
                T.append(pose)
                joints.append(posture)
                depth.append(down - 0.01 * abs(np.sin(turn)))
    poses, angles, score = np.array(T), np.array(joints), np.array(depth)
    clear = np.flatnonzero(CloudCheck(hand, ExecutionConfig()).clear(poses, angles, seen.points))
    kept = clear[np.argsort(-score[clear], kind="stable")[:MOST]]
    return {
        "position": poses[kept, :3, 3],
        "rotation": poses[kept, :3, :3],
        "joints": angles[kept],
        "joint_names": hand.dof_names,
        "score": score[kept],
    }


def grip(hand: HandModel, joints: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Middle of the fingers' inside [3], palm frame, and the direction in which they close.

    That is the principal axis [3] of the inside's normals, at right angles to the palm normal.
    """
    kinematics = HandKinematics(hand)
    points, normals = kinematics.inner_points(
        torch.eye(4, dtype=torch.float64)[None], torch.from_numpy(joints)[None]
    )
    fingers = hand.inner_link != 0
    flat = normals[0].numpy()[fingers]
    flat = flat - (flat @ hand.palm_normal)[:, None] * hand.palm_normal
    _, vectors = np.linalg.eigh(flat.T @ flat)
    across = vectors[:, -1] - (vectors[:, -1] @ hand.palm_normal) * hand.palm_normal
    return points[0].numpy()[fingers].mean(axis=0), across / np.linalg.norm(across)


def places(points: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray, float]]:
    """Where the grip's middle may be [3], the narrow direction there [3], and how deep it is."""
    for cluster in clusters(points):
        centre = cluster[:, :2].mean(axis=0)
        _, vectors = np.linalg.eigh(np.cov((cluster[:, :2] - centre).T))
        narrow = np.append(vectors[:, 0], 0.0)
        top = cluster[:, 2].max()
        for depth in DEPTHS:
            if depth == 0 or top - depth >= LOWEST:
                yield np.append(centre, max(top - depth, LOWEST)), narrow, float(depth)


def clusters(points: np.ndarray) -> list[np.ndarray]:
    """Groups [n, 3] of points that hang together."""
    pairs = cKDTree(points).query_pairs(GAP, output_type="ndarray")
    ones = np.ones(len(pairs))
    graph = coo_array((ones, (pairs[:, 0], pairs[:, 1])), shape=(len(points), len(points)))
    _, label = connected_components(graph, directed=False)
    groups = [points[label == k].astype(np.float64) for k in range(label.max() + 1)]
    found = [group for group in groups if len(group) >= LEAST]
    return found or [points.astype(np.float64)]


def _down(normal: np.ndarray, across: np.ndarray, narrow: np.ndarray, turn: float) -> np.ndarray:
    """R_world_palm [3, 3]: palm down, closing along the narrow direction, turned by an angle."""
    palm = np.stack([normal, across, np.cross(normal, across)], axis=1)
    down = np.array([0.0, 0.0, -1.0])
    world = np.stack([down, narrow, np.cross(down, narrow)], axis=1)
    about = Rotation.from_rotvec([0.0, 0.0, turn]).as_matrix()
    return about @ world @ palm.T
