"""Label matching: which ground-truth grasps are attached to which object points.

The paper attaches grasp g to point i of the same object if d_t = |p_i - p_p| <= 5 mm and
d_n = n_i . (p_p - p_i) > 0, with p_p the palm reference point. Read so ('literal'), hardly any
grasp of a real hand matches, since a palm stands off its object. By default ('projected'), d_t is
measured to p_p projected along the palm normal onto the object; d_n keeps p_p itself.
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
    NaN where it misses the object): [G, 3], all in one frame, and grasp_object [G].
    """
    points, normals = points.astype(np.float64), normals.astype(np.float64)
    centre = palm_reference if config.mode == "literal" else palm_hit
    matched = np.zeros((len(points), len(centre)), dtype=bool)
    for index in np.unique(grasp_object):
        mine = np.flatnonzero(point_object == index)
        theirs = np.flatnonzero(grasp_object == index)
        if len(mine) == 0:
            continue
        squared = sum(
            (points[mine, None, k] - centre[None, theirs, k]) ** 2 for k in range(3)
        )  # one axis at a time: a third of the memory
        near_point, near_grasp = np.nonzero(squared <= config.distance**2)
        i, g = mine[near_point], theirs[near_grasp]
        height = (normals[i] * (palm_reference[g] - points[i])).sum(1)
        matched[i[height > 0], g[height > 0]] = True
    return matched


def positive_rates(matched: np.ndarray) -> tuple[float, float]:
    """Fraction of points with a grasp, and of grasps with a point, of a table [S, G] (0 if empty).

    A grasp that matches no point is lost supervision.
    """
    if matched.size == 0:
        return 0.0, 0.0
    return float(matched.any(1).mean()), float(matched.any(0).mean())
