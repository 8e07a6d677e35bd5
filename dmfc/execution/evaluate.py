"""Trials of all scenes of a shard, as rows; K per scene, always, missing candidates included."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pandas as pd

from dmfc.config.execution import ExecutionConfig
from dmfc.config.physics import PhysicsConfig
from dmfc.config.scenes import ScenesConfig
from dmfc.errors import DmfcError
from dmfc.execution.candidates import (
    GraspCandidates,
    at_random,
    from_answer,
    from_labels,
    from_prediction,
)
from dmfc.execution.columns import grasp_columns
from dmfc.execution.diversity import diversity
from dmfc.execution.outcome import Outcome
from dmfc.execution.protocol_test import ProtocolTest, Setup, open_test
from dmfc.execution.selection import Levels, Selection, select
from dmfc.execution.trial_files import DIVERSITY, TRIALS
from dmfc.grasps.grasp_set import GraspSet
from dmfc.hand.description import HandDescription
from dmfc.hand.model import HandModel
from dmfc.methods.ask import Answered
from dmfc.network.inference import predict
from dmfc.network.model import DmfcGraspNet
from dmfc.objects.model import ObjectModel
from dmfc.outcome.features import FeatureMaker, SeededGrasps
from dmfc.outcome.head import HeadJudge
from dmfc.outcome.judge import Judge
from dmfc.prediction.cloud_check import CloudCheck
from dmfc.scenes.labels import HandAtGrasps, surviving_labels
from dmfc.scenes.scene_set import Scene, SceneSet

Source = Literal["model", "planner", "random", "method", "answers"]
Method = Callable[[Scene], Answered]
"""Somebody else's method: a scene -> what it answered, or why it did not."""
Progress = Callable[[float, str], None]


@dataclass(frozen=True)
class Evaluation:
    """All that the trials of a set of scenes depend on."""

    source: Source
    """Where grasps come from: a `network`, the labels of `grasps`, chance, or a `method`."""
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
    labels: ScenesConfig | None = None
    """How the planner's row labels the scenes; None: they have their labels."""
    judge: Judge | HeadJudge | None = None
    """Ranks the proposals; None: their confidence does."""
    method: Method | None = None
    """For the sources 'method' and 'answers' alone."""

    def __post_init__(self) -> None:
        needs_network, needs_grasps = self.source == "model", self.source == "planner"
        if needs_network != (self.network is not None) or needs_grasps != (self.grasps is not None):
            raise DmfcError(f"'{self.source}': a model needs a network, the planner needs grasps")
        if (self.source in ("method", "answers")) != (self.method is not None):
            raise DmfcError(f"'{self.source}': 'method' and 'answers' need a method, others none")
        if (self.config.score == "outcome") != (self.judge is not None):
            raise DmfcError("an outcome predictor is needed where it ranks (execution.score)")

    def proposals(self, scene: Scene) -> GraspCandidates:
        """All grasps that are proposed in a scene, before K of them are selected."""
        return self.proposed(scene)[0]

    def proposed(self, scene: Scene) -> tuple[GraspCandidates, dict[str, Any]]:
        """As `proposals`, and columns that a method adds to each trial of the scene."""
        if self.method is None:
            return self._own_proposals(scene), {}
        answered = self.method(scene)
        return from_answer(scene, answered.answer), answered.columns

    def _own_proposals(self, scene: Scene) -> GraspCandidates:
        if self.network is not None:
            return from_prediction(scene, predict(self.network, scene.points))
        if self.grasps is not None:
            return from_labels(self._labelled(scene, self.grasps), self.grasps, self.hand)
        return at_random(scene, self.hand, self.config)

    def selection(self, scene: Scene, proposed: GraspCandidates) -> Selection:
        """The at most K of all proposed that are executed, and what was left out."""
        config = self.config
        if self.method is not None:  # its score has a scale of its own
            config = dataclasses.replace(config, min_confidence=-math.inf)
        return select(self.scored(scene, proposed), config, self._levels(scene))

    def chosen(self, scene: Scene, proposed: GraspCandidates) -> GraspCandidates:
        """The at most K of all proposed that are executed."""
        return self.selection(scene, proposed).chosen

    def scored(self, scene: Scene, proposed: GraspCandidates) -> GraspCandidates:
        """The proposals with the score that ranks them."""
        if self.config.score == "confidence":
            return proposed
        # The predictor knows a network's confidence; other rows have none of the kind.
        confidence = proposed.confidence if self.network else np.full(len(proposed), np.nan)
        grasps = SeededGrasps(
            proposed.position, proposed.rotation, proposed.joints, proposed.seed_point, confidence
        )
        if self.judge is None:
            return dataclasses.replace(proposed, held=self._opposition(grasps, scene.points))
        return dataclasses.replace(proposed, held=self.judge(grasps, scene.points).held)

    def _opposition(self, grasps: SeededGrasps, points: np.ndarray) -> np.ndarray:
        """[n] in [0, 1]: 1 where thumb and fingers would press against each other."""
        column = self._features.names.index("opposed")
        return (1.0 + self._features(grasps, points)[:, column].astype(np.float64)) / 2

    def _labelled(self, scene: Scene, grasps: Mapping[str, GraspSet]) -> Scene:
        """The scene with those of the grasps that are clear of table and neighbours."""
        if self.labels is None:
            return scene
        models = [self.objects[name] for name in scene.object_ids]
        found = surviving_labels(
            self.labels, models, scene.T_world_object, grasps, self._hand_at_grasps
        )
        return dataclasses.replace(
            scene,
            grasp_object=found.grasp_object,
            grasp_index=found.grasp_index,
            dropped=found.dropped,
        )

    @cached_property
    def _hand_at_grasps(self) -> HandAtGrasps:
        return HandAtGrasps(self.hand)

    @cached_property
    def _features(self) -> FeatureMaker:
        return FeatureMaker(self.hand)

    def _levels(self, scene: Scene) -> Levels | None:
        if not self.config.cloud_check:
            return None

        def levels(grasps: GraspCandidates) -> np.ndarray:
            found = self.cloud_check.depths(grasps.T, grasps.joints, scene.points)
            passes = self.cloud_check.passes
            return passes(found).astype(int) + passes(found, self.config.cloud_margin)

        return levels

    @cached_property
    def cloud_check(self) -> CloudCheck:
        """Of grasps against what is seen of a scene."""
        return CloudCheck(self.hand, self.config)

    def open(self, scene: Scene, *, visual: bool = False) -> ProtocolTest:
        """What executes and judges grasps in a scene, its objects at rest on the table."""
        models = [self.objects[name] for name in scene.object_ids]
        return open_test(
            Setup(
                self.hand,
                self.description,
                models,
                scene.T_world_object,
                self.physics,
                self.config,
                visual,
            )
        )

    def trials(self, scene: Scene, candidates: GraspCandidates) -> Iterator[dict[str, Any]]:
        """K rows of one scene; the simulation is reset before every grasp.

        `candidates`: at most K, as `select` leaves them; a row for each that is missing too.
        """
        runner = self.open(scene)
        for trial in range(self.config.grasps_per_scene):
            outcome, target = Outcome(), ""
            if trial < len(candidates):
                which = int(candidates.object_index[trial])
                target = scene.object_ids[which]
                outcome = runner.run(candidates.T[trial], candidates.joints[trial], which)
            yield {
                "scene": scene.scene,
                "trial": trial,
                "object": target,
                **grasp_columns(candidates, trial, self.hand.dofs),
                **outcome.row(),
            }


def evaluate_shard(
    evaluation: Evaluation,
    out: Path,
    progress: Progress = lambda fraction, message: None,
) -> None:
    """Execute K grasps in every scene; writes two Parquet files into the folder `out`.

    `trials.parquet`: a row per trial; a method's has its time and failure, too.
    `diversity.parquet`: a row per scene, with the number of grasps proposed and how different those
    and the executed ones are (see `diversity`). Raises DmfcError, with the first reason, where a
    method fails in every scene.
    """
    rows: list[dict[str, Any]] = []
    spreads: list[dict[str, Any]] = []
    for done, scene in enumerate(evaluation.scenes, start=1):
        proposed, columns = evaluation.proposed(scene)
        selection = evaluation.selection(scene, proposed)
        rows += (row | columns for row in evaluation.trials(scene, selection.chosen))
        spreads.append(_spread(scene, proposed, selection))
        planned, held = (sum(row[name] for row in rows) for name in ("planned", "held"))
        told = f"planned {planned / len(rows):.2f}, held {held / len(rows):.2f} of {len(rows)}"
        progress(done / len(evaluation.scenes), told)
    if rows and all(row.get("method_failure") for row in rows):
        raise DmfcError(f"the method fails in every scene: {rows[0]['method_failure']}")
    pd.DataFrame(rows).to_parquet(out / TRIALS, index=False)
    pd.DataFrame(spreads).to_parquet(out / DIVERSITY, index=False)


def _spread(scene: Scene, proposed: GraspCandidates, selection: Selection) -> dict[str, Any]:
    executed = selection.chosen
    row: dict[str, Any] = {
        "scene": scene.scene,
        "proposed": len(proposed),
        "confident": selection.confident,
        "checked": selection.checked,
        "clear": selection.clear,
        "executed": len(executed),
    }
    for name, grasps in (("proposed", proposed), ("executed", executed)):
        row |= {f"{name}_{kind}": value for kind, value in diversity(grasps).items()}
    return row
