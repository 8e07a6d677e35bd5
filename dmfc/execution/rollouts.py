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
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from dmfc.config.outcome import RolloutsConfig
from dmfc.execution.candidates import GraspCandidates
from dmfc.execution.columns import grasp_columns
from dmfc.execution.evaluate import Evaluation, Progress
from dmfc.hand.model import HandModel
from dmfc.outcome.features import GRIP
from dmfc.scenes.scene_set import Scene

ROLLOUTS = "rollouts.parquet"
POSITION_ERROR, TURN_ERROR, JOINT_ERROR = 0.008, np.deg2rad(10), 0.1
"""Of a network: metres, rad, rad."""
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
    if config.source == "labels":
        proposed = shaken(proposed, scene, evaluation.hand, config.seed)
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


def shaken(
    labels: GraspCandidates, scene: Scene, hand: HandModel, seed: int, count: int = 256
) -> GraspCandidates:
    """So many grasps that are labels moved by up to twice the errors of a network.

    Each has a seed point, the observed one that is nearest to where its hand grips, and no
    confidence.
    """
    if not len(labels):
        return labels
    generator = np.random.default_rng([seed, scene.scene])
    moved = labels[generator.integers(len(labels), size=count)]
    scale = generator.uniform(0, 2, size=(count, 1))

    def error(size: float, columns: int) -> np.ndarray:
        """Normally distributed, of this length on average in three dimensions."""
        return scale * size / np.sqrt(3) * generator.normal(size=(count, columns))

    turn = Rotation.from_rotvec(error(TURN_ERROR, 3)).as_matrix()
    joints = scale * JOINT_ERROR * generator.normal(size=moved.joints.shape)
    rotation = turn @ moved.rotation
    position = moved.position + error(POSITION_ERROR, 3)
    grip = position + rotation @ (hand.palm_reference + GRIP * hand.palm_normal)
    return dataclasses.replace(
        moved,
        position=position,
        rotation=rotation,
        joints=np.clip(moved.joints + joints, hand.lower, hand.upper),
        confidence=np.full(count, np.nan),
        seed_point=cKDTree(scene.points).query(grip)[1],
    )


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
