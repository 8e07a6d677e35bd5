"""Quality of predictions, measured without a simulator."""

from __future__ import annotations

import dataclasses
from typing import Literal

import torch
from scipy.stats import spearmanr
from torch import Tensor

from dmfc.config.losses import LossConfig
from dmfc.config.validation import ValidationConfig
from dmfc.geometry.rotations import geodesic_angle
from dmfc.geometry.transforms import transform
from dmfc.hand.approach import Approach
from dmfc.hand.kinematics import HandKinematics
from dmfc.hand.model import HandModel
from dmfc.losses.q1 import grasp_contacts, q1_of_contacts
from dmfc.losses.q1_lower import q1_lower_of_contacts
from dmfc.losses.task import TERMS, SceneTerms
from dmfc.network.model import Prediction
from dmfc.objects.atlas import ObjectAtlas, SceneObjects
from dmfc.training.batch import Batch
from dmfc.training.candidates import Candidates
from dmfc.training.measures import label_errors

DIRECTIONS: Literal[728] = 728
"""Directions of the measured upper bound: 64 hold no nearly pure torque."""


class Validation:
    """Measures of a batch of predictions, each a mean over what its docstring says."""

    def __init__(
        self,
        config: ValidationConfig,
        losses: LossConfig,
        hand: HandModel,
        atlas: ObjectAtlas,
        approach: Approach | None = None,
    ) -> None:
        self.config = config
        self.losses = losses
        self.atlas = atlas
        self._terms = SceneTerms(hand, losses, approach)
        self._kinematics = HandKinematics(hand)
        self._q1 = dataclasses.replace(
            losses.q1, torque_weight=config.torque_weight, directions=DIRECTIONS, floor=True
        )

    @torch.no_grad()
    def measure(self, prediction: Prediction, batch: Batch) -> dict[str, Tensor]:
        """Values by name, each of any number.

        coverage: of each label, whether a prediction is near (`near_distance`, `near_angle`);
        translation_mm, rotation_deg, joints_deg: as `label_errors`; each term of the loss, whatever
        its weight: chamfer at all labelled seeds, the others at `sampled` seeds;
        penetration_mm: deepest collision point of each of the `confident` in the table or an
        object; measured_q1_upper, measured_q1_lower: theirs, with `torque_weight`.
        """
        rows = Candidates.of(prediction, batch, self.losses.grasp_space)
        found = {
            "coverage": self.coverage(prediction, batch),
            **label_errors(prediction, batch, self.losses.grasp_space),
            "chamfer": rows.chamfer[rows.positive],
        }
        sampled = rows.take(_spread(prediction.logit, self.config.sampled))
        of_scene = [*(name for name in TERMS if name != "chamfer"), *self._terms.custom.names]
        position, rotation, joints = sampled.position, sampled.rotation, sampled.joints
        objects = SceneObjects(self.atlas, batch.object_index, batch.T_world_object)
        found |= self._terms(position, rotation, joints, objects.take(sampled.scene), of_scene)
        return found | self._confident(rows.take(_best(prediction.logit, self.config)), objects)

    def coverage(self, prediction: Prediction, batch: Batch) -> Tensor:
        """Whether each label that is there has a prediction near, [labels] 0 or 1."""
        near = []
        for row, there in enumerate(batch.grasp_mask):
            position, rotation = prediction.float().position[row], prediction.float().rotation[row]
            apart = torch.cdist(batch.grasp_position[row, there], position)
            angle = geodesic_angle(batch.grasp_rotation[row, there][:, None], rotation[None])
            close = (apart <= self.config.near_distance) & (angle <= self.config.near_angle)
            near.append(close.any(dim=1))
        return torch.cat(near).float()

    def _confident(self, rows: Candidates, objects: SceneObjects) -> dict[str, Tensor]:
        around = objects.take(rows.scene)
        held = self._kinematics.clamp(rows.joints)
        T_world_link = self._kinematics.links(transform(rows.rotation, rows.position), held)
        points = self._kinematics.collision_points_of_links(T_world_link)
        inside = torch.maximum(around.distance(points).amax((1, 2)), -points[..., 2].amin(1))
        inner, _ = self._kinematics.inner_points_of_links(T_world_link)
        contacts = grasp_contacts(inner, around, self._q1)
        return {
            "penetration_mm": 1000 * inside.clamp(min=0),
            "measured_q1_upper": q1_of_contacts(*contacts, self._q1),
            "measured_q1_lower": q1_lower_of_contacts(*contacts, self._q1, self.losses.q1_lower),
        }


def calibration(task: Tensor, confidence: Tensor, weight: float) -> dict[str, Tensor]:
    """How well the confidence [n] of predictions tells their task loss [n] >= 0.

    confidence_gap [n]: |c - c*|, c* = min(w5 / task, 1) the best answer (see `confidence_loss`);
    confidence_rank [1]: Spearman's correlation of c and -task (none where either is constant).
    """
    best = (weight / task.clamp(min=torch.finfo(task.dtype).tiny)).clamp(max=1)
    ranks = []
    if confidence.min() < confidence.max() and task.min() < task.max():
        ranks = [float(spearmanr(confidence.cpu().numpy(), -task.cpu().numpy()).statistic)]
    rank = torch.tensor(ranks, dtype=torch.float32, device=task.device)
    return {"confidence_gap": (confidence - best).abs(), "confidence_rank": rank}


def _spread(logit: Tensor, count: int) -> Tensor:
    """Rows of `count` seeds of each scene of [B, m], evenly over the seeds' order."""
    scenes, seeds = logit.shape
    picked = torch.linspace(0, seeds - 1, min(count, seeds), device=logit.device).long()
    return (seeds * torch.arange(scenes, device=logit.device)[:, None] + picked).flatten()


def _best(logit: Tensor, config: ValidationConfig) -> Tensor:
    """Rows of the most confident of each scene of [B, m]."""
    scenes, seeds = logit.shape
    top = logit.topk(min(config.confident, seeds), dim=1).indices
    return (seeds * torch.arange(scenes, device=logit.device)[:, None] + top).flatten()
