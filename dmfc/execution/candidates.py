"""Grasps to be executed in a scene, wherever they come from; selection of K of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.transform import Rotation

from dmfc.config.execution import ExecutionConfig
from dmfc.grasps.grasp_set import GraspSet
from dmfc.grasps.grasps import Grasps
from dmfc.hand.model import HandModel
from dmfc.methods.answer import Answer
from dmfc.network.inference import PredictedGrasps
from dmfc.scenes.scene_grasps import grasps_in_scene
from dmfc.scenes.scene_set import Scene


@dataclass(frozen=True)
class GraspCandidates(Grasps):
    """n grasps of a scene, world frame."""

    confidence: np.ndarray
    """[n] in [0, 1]; of a method of somebody else: its score, of any scale."""
    object_index: np.ndarray
    """[n] the object of the scene that is to be grasped."""
    seed_point: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    """[n] i64 point of the cloud that the grasp was proposed at, -1: none; left out: none."""
    held: np.ndarray | None = None
    """[n] probability of being held, by an outcome predictor; None: nobody was asked."""

    def __post_init__(self) -> None:
        if len(self.seed_point) != len(self.position):
            object.__setattr__(self, "seed_point", np.full(len(self.position), -1))

    @property
    def score(self) -> np.ndarray:
        """[n] by which they are ranked, the best the largest."""
        return self.confidence if self.held is None else self.held


def from_labels(scene: Scene, grasps: Mapping[str, GraspSet], hand: HandModel) -> GraspCandidates:
    """The planner row: the scene's labels, with their robustness as confidence; 1 where a grasp
    from elsewhere has none."""
    found = grasps_in_scene(
        scene.object_ids,
        scene.T_world_object,
        scene.grasp_object,
        scene.grasp_index,
        grasps,
        hand.palm_reference,
    )
    order = np.argsort(scene.grasp_object, kind="stable")  # that of `grasps_in_scene`
    names = [scene.object_ids[k] for k in scene.grasp_object]
    rows = zip(names, scene.grasp_index, strict=True)
    robustness = np.array([grasps[name].robustness[row] for name, row in rows], dtype=np.float64)
    return GraspCandidates(
        found.position,
        found.rotation,
        found.joints,
        np.nan_to_num(robustness[order], nan=1.0),
        found.object_index,
    )


def from_prediction(scene: Scene, predicted: PredictedGrasps) -> GraspCandidates:
    """A model's row; the target is the object that the seed point lies on."""
    return GraspCandidates(
        predicted.position,
        predicted.rotation,
        predicted.joints,
        predicted.confidence,
        scene.point_object[predicted.seed_index].astype(np.int64),
        predicted.seed_index.astype(np.int64),
    )


def from_answer(scene: Scene, answer: Answer) -> GraspCandidates:
    """A method's row; the target is the object that the answer's point lies on."""
    return GraspCandidates(
        answer.position,
        answer.rotation,
        answer.joints,
        answer.score,
        scene.point_object[answer.point].astype(np.int64),
        answer.point,
    )


def at_random(scene: Scene, hand: HandModel, config: ExecutionConfig) -> GraspCandidates:
    """The random row: uniform orientations and joint angles, near random points of the cloud."""
    generator = np.random.default_rng([config.seed, scene.scene])
    count = 512
    seeds = generator.integers(len(scene.points), size=count)
    direction = generator.normal(size=(count, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    radius = config.random_offset * generator.uniform(size=(count, 1)) ** (1 / 3)
    return GraspCandidates(
        position=scene.points[seeds] + radius * direction,
        rotation=Rotation.random(count, random_state=generator).as_matrix(),
        joints=generator.uniform(hand.lower, hand.upper, (count, hand.dofs)),
        confidence=np.ones(count),
        object_index=scene.point_object[seeds].astype(np.int64),
        seed_point=seeds.astype(np.int64),
    )
