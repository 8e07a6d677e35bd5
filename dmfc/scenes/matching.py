"""Label matching: which ground-truth grasps are attached to which object points.

The paper attaches grasp g to point i of the same object if d_t = |p_i - p_p| <= 5 mm and
d_n = n_i . (p_p - p_i) > 0, with p_p the palm reference point. Read so ('literal'), hardly any
grasp of a real hand matches, since a palm stands off its object. 'projected' measures d_t to p_p
projected along the palm normal onto the object, 'patch' (the default) to the line between the two,
and gives a grasp its nearest tenth of the object's points instead of those within 5 mm. d_n is the
same in all three. `docs/matching.md` argues for the default.
"""

from __future__ import annotations

import numpy as np

from dmfc.config.scenes import MatchingConfig


def match_grasps(
    config: MatchingConfig,
    points: np.ndarray,
    normals: np.ndarray,
    point_object: np.ndarray,
    palm_reference: np.ndarray,
    palm_hit: np.ndarray,
    grasp_object: np.ndarray,
) -> np.ndarray:
    """The sets G_i as a table: bool [S, G], point by grasp.

    points, normals: [S, 3] and point_object [S]; palm_reference (p_p) and palm_hit (its projection,
    NaN where it misses the object): [G, 3], all in one frame, and grasp_object [G]. In the mode
    'patch' the table depends on which points are given: pass the seeds alone.
    """
    points, normals = points.astype(np.float64), normals.astype(np.float64)
    start = palm_hit if config.mode == "projected" else palm_reference
    end = palm_reference if config.mode == "literal" else palm_hit
    matched = np.zeros((len(points), len(start)), dtype=bool)
    for index in np.unique(grasp_object):
        mine = np.flatnonzero(point_object == index)
        theirs = np.flatnonzero(grasp_object == index)
        if len(mine) == 0:
            continue
        own, normal = points[mine], normals[mine]
        height = normal @ palm_reference[theirs].T - (normal * own).sum(1)[:, None]
        squared = _squared_distance(own, start[theirs], end[theirs])
        squared[height <= 0] = np.inf
        if config.mode == "patch":
            count = min(max(1, round(config.share * len(mine))), len(mine))
            farthest = np.partition(squared, count - 1, axis=0)[count - 1]
            limit = np.minimum(farthest, config.reach**2)
        else:
            limit = np.full(len(theirs), config.distance**2)
        matched[np.ix_(mine, theirs)] = squared <= limit
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
