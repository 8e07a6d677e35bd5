"""Trials of all scenes of a shard, as rows; K per scene, always, missing candidates included."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any, Literal

import pandas as pd

from dmfc.config.execution import ExecutionConfig
from dmfc.config.hand import HandConfig
from dmfc.config.physics import PhysicsConfig
from dmfc.errors import DmfcError
from dmfc.execution.candidates import (
    GraspCandidates,
    at_random,
    from_labels,
    from_prediction,
    select,
)
from dmfc.execution.trial import Observer, Outcome, TrialRunner
from dmfc.grasps.grasp_set import GraspSet
from dmfc.hand.description import HandDescription
from dmfc.hand.mjcf import load_description
from dmfc.hand.model import HandModel
from dmfc.network.model import DmfcGraspNet
from dmfc.objects.model import ObjectModel
from dmfc.physics.world import World
from dmfc.scenes.scene_set import Scene, SceneSet
from dmfc.training.predict import predict

Row = Literal["model", "planner", "random"]
Progress = Callable[[float, str], None]
TABLE_SIZE = 2.0
"""Side of the table that pictures show, metres; for contacts it has no end."""


def evaluate_shard(
    *,
    row: Row,
    scenes: SceneSet,
    objects: Mapping[str, ObjectModel],
    grasps: Mapping[str, GraspSet] | None,
    network: DmfcGraspNet | None,
    hand: HandModel,
    hand_config: HandConfig,
    physics: PhysicsConfig,
    config: ExecutionConfig,
    out: Path,
    progress: Progress = lambda fraction, message: None,
) -> None:
    """Execute K grasps in every scene and write a row for each to the Parquet file `out`.

    `row` says where grasps come from: a trained `network`, the labels of `grasps`, or nowhere.
    Raises DmfcError where what the row needs was not given.
    """
    if (row == "model") != (network is not None) or (row == "planner") != (grasps is not None):
        raise DmfcError(f"row '{row}': a model needs a network, the planner needs grasps")
    description = load_description(hand_config.name)
    rows: list[dict[str, Any]] = []
    held = 0
    for done, scene in enumerate(scenes, start=1):
        candidates = candidates_of(scene, row, grasps, network, hand, config)
        for trial in scene_trials(scene, candidates, objects, hand, description, physics, config):
            rows.append(trial)
            held += trial["held"]
        progress(done / len(scenes), f"{held} of {len(rows)} held")
    pd.DataFrame(rows).to_parquet(out, index=False)


def candidates_of(
    scene: Scene,
    row: Row,
    grasps: Mapping[str, GraspSet] | None,
    network: DmfcGraspNet | None,
    hand: HandModel,
    config: ExecutionConfig,
) -> GraspCandidates:
    """The grasps that a row of the table executes in a scene: at most K, selected."""
    if network is not None:
        found = from_prediction(scene, predict(network, scene.points))
    elif grasps is not None:
        found = from_labels(scene, grasps, hand)
    else:
        found = at_random(scene, hand, config)
    return select(found, config)


def scene_trials(
    scene: Scene,
    candidates: GraspCandidates,
    objects: Mapping[str, ObjectModel],
    hand: HandModel,
    description: HandDescription,
    physics: PhysicsConfig,
    config: ExecutionConfig,
    observer: Observer | None = None,
) -> Iterator[dict[str, Any]]:
    """K rows of one scene; the simulation is reset before every grasp."""
    runner = open_scene(scene, objects, hand, description, physics, config)
    for trial in range(config.grasps_per_scene):
        outcome, target, confidence = Outcome(), "", float("nan")
        if trial < len(candidates):
            which = int(candidates.object_index[trial])
            target, confidence = scene.object_ids[which], float(candidates.confidence[trial])
            outcome = runner.run(
                candidates.T_world_palm(trial), candidates.joints[trial], which, observer
            )
        yield {
            "scene": scene.scene,
            "trial": trial,
            "object": target,
            "confidence": confidence,
            **asdict(outcome),
        }


def open_scene(
    scene: Scene,
    objects: Mapping[str, ObjectModel],
    hand: HandModel,
    description: HandDescription,
    physics: PhysicsConfig,
    config: ExecutionConfig,
    *,
    visual: bool = False,
) -> TrialRunner:
    """The simulation of a scene, its objects at rest on the table."""
    models = [objects[name] for name in scene.object_ids]
    world = World(description, models, physics, table_size=TABLE_SIZE, visual=visual)
    return TrialRunner(world, hand, scene.T_world_object, config)
