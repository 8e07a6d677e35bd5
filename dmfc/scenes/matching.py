"""Label matching: which ground-truth grasps are attached to which object points.

The paper attaches grasp g to point i of the same object if d_t = |p_i - p_p| <= 5 mm and
d_n = n_i . (p_p - p_i) > 0, with p_p the palm reference point. Read so ('literal'), hardly any
grasp of a real hand matches, since a palm stands off its object. 'projected' measures d_t to p_p
projected along the palm normal onto the object, 'patch' (the default) to the line between the two,
and gives a grasp its nearest tenth of the object's points instead of those within 5 mm. d_n is the
same in all three. `docs/matching.md` argues for the default.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from dmfc.config.scenes import MatchingConfig
from dmfc.scenes.scene_grasps import SceneGrasps


class Observed(Protocol):
    """Points on objects, as a scene has them."""

    @property
    def points(self) -> np.ndarray:
        """[N, 3] metres."""

    @property
    def normals(self) -> np.ndarray:
        """[N, 3] outward, unit length."""

    @property
    def point_object(self) -> np.ndarray:
        """[N] index of the object in the scene."""


@dataclass(frozen=True)
class ObservedPoints:
    """Some points of a scene, perhaps moved."""

    points: np.ndarray
    normals: np.ndarray
    point_object: np.ndarray

    @classmethod
    def of(cls, observed: Observed, rows: np.ndarray) -> ObservedPoints:
        """Those at `rows`."""
        return cls(observed.points[rows], observed.normals[rows], observed.point_object[rows])


def match_grasps(config: MatchingConfig, observed: Observed, grasps: SceneGrasps) -> np.ndarray:
    """The sets G_i as a table: bool [S, G], point by grasp.

    S points and G grasps, in one frame. In the mode 'patch' the table depends on which points are
    given: pass the seeds alone.
    """
    points, normals = observed.points.astype(np.float64), observed.normals.astype(np.float64)
    start = grasps.palm_hit if config.mode == "projected" else grasps.palm_reference
    end = grasps.palm_reference if config.mode == "literal" else grasps.palm_hit
    matched = np.zeros((len(points), len(start)), dtype=bool)
    for index in np.unique(grasps.object_index):
        rows = np.flatnonzero(observed.point_object == index)
        columns = np.flatnonzero(grasps.object_index == index)
        if len(rows) == 0:
            continue
        point, normal = points[rows], normals[rows]
        offset = (normal * point).sum(1)[:, None]
        height = normal @ grasps.palm_reference[columns].T - offset
        squared = _squared_distance(point, start[columns], end[columns])
        squared[height <= 0] = np.inf
        if config.mode == "patch":
            count = min(max(1, round(config.share * len(rows))), len(rows))
            farthest = np.partition(squared, count - 1, axis=0)[count - 1]
            limit = np.minimum(farthest, config.reach**2)
        else:
            limit = np.full(len(columns), config.distance**2)
        matched[np.ix_(rows, columns)] = squared <= limit
    return matched


def _squared_distance(points: np.ndarray, start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Of points [n, 3] from the segments start..end, [g, 3] each: [n, g]; NaN where an end is."""
    along = end - start
    length = (along**2).sum(1)
    share = points @ along.T - (start * along).sum(1)
    share = np.clip(share / np.where(length > 0, length, 1.0), 0.0, 1.0)
    squared = np.zeros((len(points), len(start)))
    for k in range(3):  # one axis at a time: a third of the memory
        squared += (points[:, k, None] - start[:, k] - share * along[:, k]) ** 2
    return squared
