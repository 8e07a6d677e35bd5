"""What a scene set holds: counts, how many labels match, and why labels were dropped."""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any, Literal

import numpy as np

from dmfc.config.scenes import MatchingConfig
from dmfc.geometry.points import farthest_points
from dmfc.grasps.grasp_set import GraspSet
from dmfc.scenes.carry import grasps_in_scene
from dmfc.scenes.labels import REASONS
from dmfc.scenes.matching import match_grasps
from dmfc.scenes.scene_set import Scene

MODES: tuple[Literal["projected", "literal"], ...] = ("projected", "literal")


def scene_stats(
    scenes: Sequence[Scene],
    grasps: Mapping[str, GraspSet] | None,
    palm_reference: np.ndarray,
    matching: MatchingConfig,
    seeds: int = 512,
) -> dict[str, Any]:
    """Counts of a scene set and the positive rates of both matching modes.

    `positive_points` and `positive_grasps` are fractions over all points and all surviving labels
    of the set; with `_of_seeds` they are over the `seeds` farthest points that a network sees. A
    grasp that matches no point is lost supervision. Without `grasps` there are no rates.
    """
    objects = Counter(name for scene in scenes for name in scene.object_ids)
    stats: dict[str, Any] = {
        "scenes": len(scenes),
        "objects_per_scene": sum(objects.values()) / max(1, len(scenes)),
        "objects": len(objects),
        "appearances_min": min(objects.values(), default=0),
        "appearances_max": max(objects.values(), default=0),
        "points": sum(len(scene.points) for scene in scenes),
        "grasps": sum(len(scene.grasp_index) for scene in scenes),
        "dropped": {r: sum(scene.dropped.get(r, 0) for scene in scenes) for r in REASONS},
    }
    if grasps is not None:
        stats["matching"] = _rates(scenes, grasps, palm_reference, matching, seeds)
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
    counts = {mode: Counter[str]() for mode in MODES}
    total = Counter[str]()
    for scene in scenes:
        labels = (scene.grasp_object, scene.grasp_index)
        own = grasps_in_scene(
            scene.object_ids, scene.T_world_object, *labels, grasps, palm_reference
        )
        chosen = farthest_points(scene.points, min(seeds, len(scene.points)))
        total += Counter(points=len(scene.points), seeds=len(chosen), grasps=len(own.position))
        for mode in MODES:
            matched = match_grasps(
                dataclasses.replace(matching, mode=mode),
                scene.points,
                scene.normals,
                scene.point_object,
                own.palm_reference,
                own.palm_hit,
                own.object_index,
            )
            counts[mode]["points"] += int(matched.any(1).sum())
            counts[mode]["grasps"] += int(matched.any(0).sum())
            counts[mode]["seeds"] += int(matched[chosen].any(1).sum())
            counts[mode]["grasps_of_seeds"] += int(matched[chosen].any(0).sum())
    wholes = {"points": "points", "grasps": "grasps", "seeds": "seeds", "grasps_of_seeds": "grasps"}
    return {
        mode: {
            f"positive_{name}": counts[mode][name] / max(1, total[whole])
            for name, whole in wholes.items()
        }
        for mode in MODES
    }
