"""Statistics of a scene set: counts, matched labels, and reasons for dropped labels."""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any, Literal

import numpy as np

from dmfc.config.scenes import MatchingConfig
from dmfc.geometry.points import farthest_points
from dmfc.grasps.grasp_set import GraspSet
from dmfc.scenes.labels import REASONS
from dmfc.scenes.matching import ObservedPoints, match_grasps
from dmfc.scenes.scene_grasps import grasps_in_scene
from dmfc.scenes.scene_set import Scene

RATED = 400
"""Positive rates are those of so many scenes at most, spread over the set."""
MODES: tuple[Literal["patch", "projected", "literal"], ...] = ("patch", "projected", "literal")


def scene_stats(
    scenes: Sequence[Scene],
    grasps: Mapping[str, GraspSet] | None,
    palm_reference: np.ndarray,
    matching: MatchingConfig,
    seeds: int = 512,
) -> dict[str, Any]:
    """Counts of a scene set and the positive rates of all matching modes.

    `positive_points` and `positive_grasps` are fractions over all points and all surviving labels
    of the set; with `_of_seeds` they are over the `seeds` farthest points that a network sees. A
    grasp that matches no point is lost supervision. Of a large set `RATED` scenes are rated;
    without `grasps` none is.
    """
    objects: Counter[str] = Counter()
    dropped: Counter[str] = Counter()
    points = 0
    per_scene = []
    for scene in scenes:
        objects.update(scene.object_ids)
        dropped.update(scene.dropped)
        points += len(scene.points)
        per_scene.append(len(scene.grasp_index))
    stats: dict[str, Any] = {
        "scenes": len(scenes),
        "objects_per_scene": sum(objects.values()) / max(1, len(scenes)),
        "objects": len(objects),
        "appearances_min": min(objects.values(), default=0),
        "appearances_max": max(objects.values(), default=0),
        "points": points,
        "grasps": sum(per_scene),
        "grasps_per_scene_median": float(np.median(per_scene)),
        "scenes_without_grasps": per_scene.count(0),
        "dropped": {reason: dropped[reason] for reason in REASONS},
    }
    if grasps is not None:
        chosen = np.unique(np.linspace(0, len(scenes) - 1, min(len(scenes), RATED)).astype(int))
        rated = [scenes[i] for i in chosen]
        stats["scenes_rated"] = len(rated)
        stats["matching"] = _rates(rated, grasps, palm_reference, matching, seeds)
    return stats


def stats_rows(stats: Mapping[str, Any]) -> list[dict[str, str]]:
    """The same as rows of a table with the columns quantity and value."""
    rows = []
    for name, value in stats.items():
        if isinstance(value, Mapping):
            rows += [
                {"quantity": f"{name} {row['quantity']}", "value": row["value"]}
                for row in stats_rows(value)
            ]
        else:
            text = f"{value:.3f}" if isinstance(value, float) else str(value)
            rows.append({"quantity": name.replace("_", " "), "value": text})
    return rows


def _rates(
    scenes: Sequence[Scene],
    grasps: Mapping[str, GraspSet],
    palm_reference: np.ndarray,
    matching: MatchingConfig,
    seeds: int,
) -> dict[str, dict[str, float]]:
    """Mode -> fractions of points and of grasps that have a partner."""
    wholes = {"points": "points", "grasps": "grasps", "seeds": "seeds", "grasps_of_seeds": "grasps"}
    counts = {mode: Counter[str]() for mode in MODES}
    total = Counter[str]()
    for scene in scenes:
        labels = (scene.grasp_object, scene.grasp_index)
        in_world = grasps_in_scene(
            scene.object_ids, scene.T_world_object, *labels, grasps, palm_reference
        )
        everything = np.arange(len(scene.points))
        chosen = farthest_points(scene.points, min(seeds, len(scene.points)))
        total += Counter(points=len(everything), seeds=len(chosen), grasps=len(in_world))
        for mode in MODES:
            by_mode = dataclasses.replace(matching, mode=mode)
            for rows, of_points, of_grasps in (
                (everything, "points", "grasps"),
                (chosen, "seeds", "grasps_of_seeds"),
            ):
                matched = match_grasps(by_mode, ObservedPoints.of(scene, rows), in_world)
                counts[mode][of_points] += int(matched.any(1).sum())
                counts[mode][of_grasps] += int(matched.any(0).sum())
    return {
        mode: {
            f"positive_{name}": counts[mode][name] / max(1, total[whole])
            for name, whole in wholes.items()
        }
        for mode in MODES
    }
