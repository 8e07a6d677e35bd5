"""Statistics of grasp sets as labels, matched in scenes of single objects."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from dmfc.config.scenes import MatchingConfig, ScenesConfig, SceneSetConfig
from dmfc.grasps.grasp_set import GraspSet
from dmfc.hand.model import HandModel
from dmfc.objects.model import ObjectModel
from dmfc.scenes.make import SceneMaker
from dmfc.scenes.publish.stats import scene_stats
from dmfc.scenes.scene_set import Scene


def single_scenes(
    config: ScenesConfig,
    objects: Mapping[str, ObjectModel],
    grasps: Mapping[str, GraspSet],
    hand: HandModel,
    each: int,
    progress: Callable[[str], None] = lambda object_id: None,
) -> dict[str, list[Scene]]:
    """`each` scenes of every object alone, in random stable poses: object -> scenes."""
    scenes = SceneSetConfig(kind="single", count=each, seed=config.train.seed)
    made = {}
    for object_id in objects:
        progress(object_id)
        alone = {object_id: objects[object_id]}
        with SceneMaker(config, scenes, alone, grasps, hand) as maker:
            made[object_id] = [maker.make(number) for number in range(each)]
    return made


def label_row(
    scenes: list[Scene],
    grasps: Mapping[str, GraspSet],
    hand: HandModel,
    matching: MatchingConfig,
    seeds: int,
) -> dict[str, Any]:
    """Labels per scene that are clear of the table, and per matching mode two shares: of the seeds
    that are positive, and of those labels that match no seed (lost supervision)."""
    stats = scene_stats(scenes, grasps, np.asarray(hand.palm_reference), matching, seeds)
    row: dict[str, Any] = {"labels_per_scene": stats["grasps"] / max(1, stats["scenes"])}
    for mode, rates in stats["matching"].items():
        row[f"{mode}_positive"] = rates["positive_seeds"]
        lost = 1 - rates["positive_grasps_of_seeds"] if stats["grasps"] else None
        row[f"{mode}_unmatched"] = lost
    return row
