"""Many trials of a model's predictions, from which an outcome predictor learns.

Evaluation executes the best K of a scene. To learn the difference, bad grasps are needed, too: most
are drawn uniformly among all that are clear of the cloud, some are the most confident, some are
refused by the cloud, which planning then mostly refuses in a millisecond.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from dmfc.config.outcome import RolloutsConfig
from dmfc.execution.candidates import GraspCandidates
from dmfc.execution.columns import grasp_columns
from dmfc.execution.evaluate import Evaluation, Progress
from dmfc.scenes.scene_set import Scene

ROLLOUTS = "rollouts.parquet"
CHUNK = 32
"""Grasps that are checked against the cloud at a time, until enough are found."""


def roll_out(
    evaluation: Evaluation,
    config: RolloutsConfig,
    out: Path,
    progress: Progress = lambda fraction, message: None,
) -> None:
    """Execute chosen predictions in every scene; writes `rollouts.parquet` into the folder `out`.

    A row per trial, as in a trial table, with the column `choice`: uniform, confident or refused.
    """
    shorter = dataclasses.replace(evaluation.config, hold_time=config.hold_time, score="confidence")
    evaluation = dataclasses.replace(evaluation, config=shorter)
    rows: list[dict[str, Any]] = []
    for done, scene in enumerate(evaluation.scenes, start=1):
        rows += _scene_rows(evaluation, config, scene)
        progress(done / len(evaluation.scenes), f"scene {scene.scene}")
    pd.DataFrame(rows).to_parquet(out / ROLLOUTS, index=False)


def _scene_rows(
    evaluation: Evaluation, config: RolloutsConfig, scene: Scene
) -> Iterator[dict[str, Any]]:
    proposed = evaluation.proposals(scene)
    choices = choose(evaluation, config, scene, proposed)
    runner = evaluation.open(scene)
    trial = 0
    for choice, chosen in choices.items():
        for row in chosen:
            target = int(proposed.object_index[row])
            outcome = runner.run(proposed.T[row], proposed.joints[row], target)
            yield {
                "scene": scene.scene,
                "trial": trial,
                "object": scene.object_ids[target],
                "object_index": target,
                "choice": choice,
                **grasp_columns(proposed, row, evaluation.hand.dofs),
                **outcome.row(),
            }
            trial += 1


def choose(
    evaluation: Evaluation, config: RolloutsConfig, scene: Scene, proposed: GraspCandidates
) -> dict[str, list[int]]:
    """Rows of the proposals by why they were chosen; none twice. Depends on the scene alone."""
    generator = np.random.default_rng([config.seed, scene.scene, len(proposed)])
    shuffled = generator.permutation(len(proposed))
    ranked = np.argsort(-proposed.confidence, kind="stable")
    confident, _ = _looked_at(evaluation, scene, proposed, ranked, config.confident, 0)
    left = shuffled[~np.isin(shuffled, confident)]
    uniform, refused = _looked_at(evaluation, scene, proposed, left, config.uniform, config.refused)
    return {"uniform": uniform, "confident": confident, "refused": refused}


def _looked_at(
    evaluation: Evaluation,
    scene: Scene,
    proposed: GraspCandidates,
    order: np.ndarray,
    clear: int,
    refused: int,
) -> tuple[list[int], list[int]]:
    """The first so many clear and refused ones in an order of rows [n]."""
    passed: list[int] = []
    stopped: list[int] = []
    for first in range(0, len(order), CHUNK):
        if len(passed) >= clear and len(stopped) >= refused:
            break
        rows = order[first : first + CHUNK]
        some = proposed[rows]
        found = evaluation.cloud_check.clear(some.T, some.joints, scene.points)
        passed += rows[found].tolist()
        stopped += rows[~found].tolist()
    return passed[:clear], stopped[:refused]
