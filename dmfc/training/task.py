"""The task loss of a stage: which terms it has, of which predictions, in full and cheaply."""

from __future__ import annotations

import dataclasses
from collections.abc import Collection
from typing import Literal

import torch
from torch import Tensor

from dmfc.config.losses import LossConfig, LossWeights
from dmfc.errors import DmfcError
from dmfc.hand.approach import Approach
from dmfc.hand.kinematics import HandKinematics
from dmfc.hand.model import HandModel
from dmfc.losses.custom import term_name
from dmfc.losses.task import SceneTerms, active_terms, weighted_sum
from dmfc.network.model import Prediction
from dmfc.objects.atlas import ObjectAtlas, SceneObjects
from dmfc.training.batch import Batch
from dmfc.training.candidates import Candidates

Stage = Literal["pretrain", "finetune"]
Seeds = Literal["all", "labelled"]

RANK_DIRECTIONS: Literal[64] = 64
"""Directions of Q1 that suffice to find the hardest."""
STAND_IN = {"q1_lower": "q1_upper"}
"""Terms too expensive for every prediction, and the term that ranks in their place."""


class Task:
    """Terms per predicted grasp. Pre-training has chamfer alone, with weight 1."""

    def __init__(
        self,
        stage: Stage,
        config: LossConfig,
        hand: HandModel,
        atlas: ObjectAtlas,
        rank_points: int,
        seeds: Seeds = "all",
        approach: Approach | None = None,
    ) -> None:
        """`rank_points`: collision points of the hand in `errors`; 0: all, and Q1 in full.

        `seeds`: whose predictions have a task loss (setting training.finetune_seeds).
        `approach`: what is swept (None: that of execution by default).
        Raises DmfcError where every weight of the stage is 0.
        """
        self.stage = stage
        self.weights = config.weights
        if stage == "pretrain":
            self.weights = LossWeights(1.0, 0.0, 0.0, 0.0, confidence=config.weights.confidence)
            config = dataclasses.replace(config, custom={})
        self.custom = {term_name(text): weight for text, weight in config.custom.items()}
        custom = [name for name, weight in self.custom.items() if weight != 0]
        self.names = [*active_terms(self.weights), *custom]
        if not self.names:
            raise DmfcError(f"{stage} has no loss: all of losses.weights are 0")
        self.of_scene = [name for name in self.names if name != "chamfer"]
        self.labelled = seeds == "labelled" or not self.of_scene
        self.space, self.relative = config.grasp_space, config.relative
        self.atlas = atlas
        self._full = SceneTerms(hand, config, approach)
        self._cheap, self._ranked = self._full, self.of_scene
        if rank_points > 0:
            self._ranked = [STAND_IN.get(name, name) for name in self.of_scene]
            q1 = dataclasses.replace(config.q1, directions=RANK_DIRECTIONS)
            thinned, fewer = hand.thinned(rank_points), dataclasses.replace(config, q1=q1)
            self._cheap = SceneTerms(thinned, fewer, approach)

    def candidates(self, prediction: Prediction, batch: Batch) -> Candidates:
        """The predictions that have a task loss: all, or those with a label.

        The latter where chamfer is the only term, or where it was asked for.
        """
        rows = Candidates.of(prediction, batch, self.space)
        return rows.take(rows.positive) if self.labelled else rows

    def terms(self, rows: Candidates, batch: Batch) -> dict[str, Tensor]:
        """Each term `[n]`, not weighted, with gradients."""
        return self._terms(rows, batch, self._full, self.of_scene)

    @property
    def kinematics(self) -> HandKinematics:
        return self._full.kinematics

    def cheap_terms(self, rows: Candidates, batch: Batch) -> dict[str, Tensor]:
        """The terms of the scene `[n]`, found cheaply, with gradients; chamfer is not one."""
        terms = self._terms(rows, batch, self._cheap, self._ranked)
        return {n: terms[n if n in terms else STAND_IN[n]] for n in self.of_scene}

    @torch.no_grad()
    def errors(self, rows: Candidates, batch: Batch) -> Tensor:
        """The task loss `[n]` found cheaply: no gradients, less points and directions, no hull."""
        terms = self._terms(rows, batch, self._cheap, self._ranked)
        return self.total({n: terms[n if n in terms else STAND_IN[n]] for n in self.names})

    @torch.no_grad()
    def exact_errors(self, rows: Candidates, batch: Batch) -> Tensor:
        """The task loss `[n]` in full, without gradients: what `errors` stands for."""
        return self.total(self.terms(rows, batch))

    def total(self, terms: dict[str, Tensor]) -> Tensor:
        """task_i = w1 chamfer + w2 collision + w3 guidance + w4 q1_upper + ..., `[n]`."""
        return weighted_sum(terms, self.weights, self.custom)

    def _terms(
        self, rows: Candidates, batch: Batch, compute: SceneTerms, of_scene: Collection[str]
    ) -> dict[str, Tensor]:
        terms = {"chamfer": rows.chamfer} if "chamfer" in self.names else {}
        if not of_scene:
            return terms
        found = self._of_scene(rows, batch, compute, of_scene)
        if self.relative:
            with torch.no_grad():
                least = self._of_scene(rows.at_labels(batch), batch, compute, of_scene)
            for name, value in found.items():
                beyond = (value - least[name]).clamp(min=0)
                found[name] = torch.where(rows.positive, beyond, value)
        return terms | found

    def _of_scene(
        self, rows: Candidates, batch: Batch, compute: SceneTerms, names: Collection[str]
    ) -> dict[str, Tensor]:
        objects = SceneObjects(self.atlas, batch.object_index, batch.T_world_object)
        # in float32 whatever the network's precision: penetrations are millimetres
        with torch.autocast(rows.position.device.type, enabled=False):
            placed = rows.position, rows.rotation, rows.joints
            return compute(*placed, objects.take(rows.scene), names)
