"""Retrieval: the labels of the labelled object whose box is most like the cluster's, carried over.

The labelled objects are the 24 generated ones of the package's library (`procedural:24`), so it
needs no training and no download. It must not be tested on them.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import trimesh
from scipy.spatial import QhullError, cKDTree
from scipy.spatial.transform import Rotation

from dmfc.config.execution import ExecutionConfig
from dmfc.grasps.grasp_set import GraspSet
from dmfc.grasps.library import in_library, library_file, library_folder
from dmfc.methods.baselines.top_down import clusters
from dmfc.methods.observation import Observation
from dmfc.objects import procedural
from dmfc.prediction.cloud_check import CloudCheck

OBJECTS = 24
SAMPLES = 1500
"""Points on each labelled object."""
NEAREST = 3
"""Labelled objects that are tried for each cluster."""
LOOKED_AT = 300
"""Points of a cluster that are compared with a surface."""
TURNS = Rotation.create_group("O").as_matrix()
"""[24, 3, 3] that map axes to axes: sides of about one length may be taken for each other."""


@dataclass(frozen=True)
class Labelled:
    """An object with its labels, in the frame of its box: axes by extent, the longest first."""

    extents: np.ndarray
    """[3] m."""
    surface: np.ndarray
    """[n, 3]."""
    position: np.ndarray
    """[m, 3] palm origins."""
    rotation: np.ndarray
    """[m, 3, 3] R_box_palm."""
    joints: np.ndarray
    """[m, D] rad."""
    robustness: np.ndarray
    """[m] in [0, 1]."""


def predict(seen: Observation) -> dict[str, Any]:
    """The labels of the most similar objects, those that are clear of the cloud."""
    hand = seen.hand
    known = labelled(hand.name)
    position, rotation, joints, score = [], [], [], []
    for cluster in clusters(seen.points):
        axes, centre, extents = box_of(cluster)
        order = np.argsort([np.abs(one.extents - extents).max() for one in known], kind="stable")
        for one in (known[k] for k in order[:NEAREST]):
            turn, error = _aligned((cluster - centre) @ axes, one.surface)
            R_world_box = axes @ turn
            position.append(one.position @ R_world_box.T + centre)
            rotation.append(R_world_box @ one.rotation)
            joints.append(one.joints)
            score.append(one.robustness - error / 0.01)
    found = [np.concatenate(parts) for parts in (position, rotation, joints, score)]
    T = np.tile(np.eye(4), (len(found[0]), 1, 1))
    T[:, :3, 3], T[:, :3, :3] = found[0], found[1]
    kept = CloudCheck(hand, ExecutionConfig()).clear(T, found[2], seen.points)
    names = ("position", "rotation", "joints", "score")
    answer = {name: part[kept] for name, part in zip(names, found, strict=True)}
    return answer | {"joint_names": hand.dof_names}


@cache
def labelled(hand: str) -> list[Labelled]:
    """The labelled objects of a hand. Raises DmfcError where the library has none of them."""
    found = []
    names = [f"procedural/{procedural.name_of(number)}" for number in range(OBJECTS)]
    there = [name for name in names if in_library(hand, name, library_folder())]
    for name in there or names[:1]:
        grasps = GraspSet.load(library_file(hand, name))
        mesh = procedural.generate(procedural.number_of(name.partition("/")[2]))
        surface, _ = trimesh.sample.sample_surface(mesh, SAMPLES, seed=0)
        axes, centre, extents = box_of(np.asarray(surface))
        found.append(
            Labelled(
                extents,
                (surface - centre) @ axes,
                (grasps.position - centre) @ axes,
                axes.T @ grasps.rotation,
                grasps.joints,
                np.nan_to_num(grasps.robustness, nan=1.0),
            )
        )
    return found


def box_of(points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Right-handed axes [3, 3] (columns, the longest first), middle [3] and extents [3] m of the
    smallest box around points."""
    try:
        T_box_world, extents = trimesh.bounds.oriented_bounds(points)
        axes = T_box_world[:3, :3].T
    except QhullError:  # they lie in a plane
        _, axes = np.linalg.eigh(np.cov((points - points.mean(axis=0)).T))
        extents = np.ptp(points @ axes, axis=0)
    axes = axes[:, np.argsort(-extents, kind="stable")]
    axes[:, 2] = np.cross(axes[:, 0], axes[:, 1])
    low, high = (points @ axes).min(axis=0), (points @ axes).max(axis=0)
    return axes, axes @ ((low + high) / 2), high - low


def _aligned(points: np.ndarray, surface: np.ndarray) -> tuple[np.ndarray, float]:
    """The turn [3, 3] of a surface after which points are nearest to it, and their mean distance.

    Both are in the frames of their boxes.
    """
    tree = cKDTree(surface)
    some = points[:: max(1, len(points) // LOOKED_AT)]
    errors = [tree.query(some @ turn)[0].mean() for turn in TURNS]
    best = int(np.argmin(errors))
    return TURNS[best], float(errors[best])
