"""Trials of all scenes of a shard, as rows; K per scene, always, missing candidates included."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

import pandas as pd

from dmfc.config.execution import ExecutionConfig
from dmfc.config.physics import PhysicsConfig
from dmfc.errors import DmfcError
from dmfc.execution.candidates import (
    GraspCandidates,
    at_random,
    from_labels,
    from_prediction,
    select,
)
from dmfc.execution.trial import Outcome, TrialRunner
from dmfc.grasps.grasp_set import GraspSet
from dmfc.hand.description import HandDescription
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


@dataclass(frozen=True)
class Evaluation:
    """All that the trials of a set of scenes depend on."""

    row: Row
    """Where grasps come from: a trained `network`, the labels of `grasps`, or chance."""
    scenes: SceneSet
    objects: Mapping[str, ObjectModel]
    grasps: Mapping[str, GraspSet] | None
    """For the planner's row alone."""
    network: DmfcGraspNet | None
    """For a model's row alone."""
    hand: HandModel
    description: HandDescription
    physics: PhysicsConfig
    config: ExecutionConfig

    def __post_init__(self) -> None:
        if (self.row == "model") != (self.network is not None) or (self.row == "planner") != (
            self.grasps is not None
        ):
            raise DmfcError(f"row '{self.row}': a model needs a network, the planner needs grasps")

    def candidates(self, scene: Scene) -> GraspCandidates:
        """The grasps executed in a scene: at most K, selected."""
        if self.network is not None:
            found = from_prediction(scene, predict(self.network, scene.points))
        elif self.grasps is not None:
            found = from_labels(scene, self.grasps, self.hand)
        else:
            found = at_random(scene, self.hand, self.config)
        return select(found, self.config)

    def open(self, scene: Scene, *, visual: bool = False) -> TrialRunner:
        """The simulation of a scene, its objects at rest on the table."""
        models = [self.objects[name] for name in scene.object_ids]
        world = World(self.description, models, self.physics, table_size=TABLE_SIZE, visual=visual)
        return TrialRunner(world, self.hand, scene.T_world_object, self.config)

    def trials(self, scene: Scene) -> Iterator[dict[str, Any]]:
        """K rows of one scene; the simulation is reset before every grasp."""
        runner, candidates = self.open(scene), self.candidates(scene)
        for trial in range(self.config.grasps_per_scene):
            outcome, target, confidence = Outcome(), "", float("nan")
            if trial < len(candidates):
                which = int(candidates.object_index[trial])
                target, confidence = scene.object_ids[which], float(candidates.confidence[trial])
                outcome = runner.run(
                    candidates.T_world_palm(trial), candidates.joints[trial], which
                )
            yield {
                "scene": scene.scene,
                "trial": trial,
                "object": target,
                "confidence": confidence,
                **asdict(outcome),
            }


def evaluate_shard(
    evaluation: Evaluation,
    out: Path,
    progress: Progress = lambda fraction, message: None,
) -> None:
    """Execute K grasps in every scene and write a row for each to the Parquet file `out`."""
    rows: list[dict[str, Any]] = []
    held = 0
    for done, scene in enumerate(evaluation.scenes, start=1):
        for trial in evaluation.trials(scene):
            rows.append(trial)
            held += trial["held"]
        progress(done / len(evaluation.scenes), f"{held} of {len(rows)} held")
    pd.DataFrame(rows).to_parquet(out, index=False)
