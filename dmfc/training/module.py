"""The Lightning module: a batch -> task loss with confidence over the hardest predictions."""

from __future__ import annotations

import math
import time
from typing import Any

import numpy as np
import torch
from lightning.pytorch import LightningModule
from torch import Tensor

from dmfc.config.training import StageSchedule, TrainingConfig
from dmfc.errors import DmfcError
from dmfc.losses.confidence import confidence_loss
from dmfc.network.model import DmfcGraspNet, Prediction
from dmfc.training.batch import Batch
from dmfc.training.candidates import Candidates
from dmfc.training.diagnostics import Diagnostics
from dmfc.training.failure import Failure
from dmfc.training.means import Means
from dmfc.training.measures import label_errors
from dmfc.training.projection import project
from dmfc.training.selection import hardest
from dmfc.training.task import Task
from dmfc.training.validation import Validation, calibration


class GraspTraining(LightningModule):
    """Trains `net` on `task`. `metrics` holds a row per finished epoch.

    Where a loss or a gradient is not finite the run stops with a DmfcError that names the term and
    the scene, and `failure` saves the batch and the weights that led there. `data_digest` says
    which data the checkpoints belong to. Batches of validation need a `validation`. What
    `diagnostics` measure is in the row of each epoch.
    """

    data_digest = ""

    def __init__(
        self,
        net: DmfcGraspNet,
        task: Task,
        config: TrainingConfig,
        failure: Failure,
        validation: Validation | None = None,
        diagnostics: Diagnostics | None = None,
    ) -> None:
        super().__init__()
        self.net = net
        self.task = task
        self.config = config
        self.failure = failure
        self.validation = validation
        self.diagnostics = diagnostics
        self.metrics: list[dict[str, Any]] = []
        self._means = Means()
        self._validation_means = Means()
        self._started = 0.0
        self._batch: Batch | None = None

    @property
    def schedule(self) -> StageSchedule:
        stage: StageSchedule = getattr(self.config, self.task.stage)
        return stage

    def training_step(self, batch: Batch, batch_index: int) -> Tensor | None:
        """The loss of a batch; None, which skips the step, where it has nothing to learn from."""
        self._batch = batch
        prediction = self.net(batch.points, batch.seed_index)
        candidates = self.task.candidates(prediction, batch)
        self._measure(prediction, batch)
        if len(candidates) == 0:
            return None
        chosen = self.hardest(candidates, batch)
        error, terms = self._errors(chosen, batch)
        self._require_finite(terms, chosen)
        loss = confidence_loss(error, chosen.logit, self.task.weights.confidence)
        if self.config.negatives == "push_down":
            loss = loss + self.task.weights.confidence * _push_down(prediction.logit, batch)
        self._means.add("loss", loss)
        for name, values in terms.items():
            self._means.add(name, values[chosen.positive] if name == "chamfer" else values)
        return loss

    def _errors(self, chosen: Candidates, batch: Batch) -> tuple[Tensor, dict[str, Tensor]]:
        """The error that is back-propagated `[n]`, and the terms that the task loss has."""
        if self.task.stage == "pretrain" or self.config.finetune_form == "gradient":
            terms = self.task.terms(chosen, batch)
            return self.task.total(terms), terms
        projection = self.config.projection
        found = project(chosen, batch, self.task, projection)
        chamfer = {"chamfer": chosen.chamfer} if "chamfer" in self.task.names else {}
        terms = {**chamfer, **found.before}
        distance = found.distance(chosen, self.task.space)
        self._means.add("projected", distance)
        self._means.add("projected_share", found.moved.float())
        for name, values in found.after.items():
            self._means.add(f"{name}_at_target", values)
        return self.task.total(terms) + projection.weight * distance, terms

    def _measure(self, prediction: Prediction, batch: Batch) -> None:
        means = self._means
        means.add("scenes", batch.scene_number)
        means.add("positive_rate", batch.match.any(-1).float())
        means.add("confidence", prediction.confidence)
        for name, values in label_errors(prediction, batch, self.task.space).items():
            means.add(name, values)

    def hardest(self, candidates: Candidates, batch: Batch) -> Candidates:
        """Those of the candidates that are back-propagated."""
        if not self._selects(candidates):
            return candidates
        if self.config.hard_error == "random":
            error = self._drawn(len(candidates)).to(candidates.logit.device)
        else:
            error = self.task.errors(candidates, batch)
        return candidates.take(self._pick(error, candidates))

    def _drawn(self, count: int) -> Tensor:
        """Random numbers `[count]` that follow from the seed and the number of the step."""
        words = np.random.SeedSequence(self.config.seed, spawn_key=(self.global_step,))
        return torch.from_numpy(np.random.default_rng(words).random(count))

    def _selects(self, candidates: Candidates) -> bool:
        all_count = self.config.hard_stages == "finetune" and self.task.stage == "pretrain"
        return not all_count and 0 < self.config.hard_samples < len(candidates)

    def _pick(self, error: Tensor, candidates: Candidates) -> Tensor:
        if self.config.hard_error == "weighted":
            error = error * candidates.logit.detach().sigmoid()
        return hardest(error, candidates.scene, self.config.hard_samples, self.config.hard_scope)

    def validation_step(self, batch: Batch, batch_index: int) -> None:
        """Adds to the means of the epoch; `rank_overlap` is expensive: first batch alone.

        rank_overlap: the share of the predictions that the exact task loss would choose as the
        hardest which the cheap one chose too.
        """
        assert self.validation is not None
        means, prediction = self._validation_means, self.net(batch.points, batch.seed_index)
        means.add("positive_rate", batch.match.any(-1).float())
        means.add("confidence", prediction.confidence)
        for name, values in self.validation.measure(prediction, batch).items():
            means.add(name, values)
        candidates = self.task.candidates(prediction, batch)
        if len(candidates) == 0:
            return
        error = self.task.errors(candidates, batch)
        told = calibration(error, candidates.logit.sigmoid(), self.task.weights.confidence)
        for name, values in told.items():
            means.add(name, values)
        if batch_index == 0 and self._selects(candidates):
            cheap = self._pick(error, candidates)
            exact = self._pick(self.task.exact_errors(candidates, batch), candidates)
            means.add("rank_overlap", torch.isin(exact, cheap).float())

    def on_validation_epoch_start(self) -> None:
        self._validation_means = Means()

    def on_validation_epoch_end(self) -> None:
        self._add_row("val", self._result(self._validation_means))

    def configure_optimizers(self) -> torch.optim.Optimizer:
        return torch.optim.Adam(self.net.parameters(), lr=self.schedule.learning_rate)

    def on_train_epoch_start(self) -> None:
        """Learning rate and randomness of an epoch follow from its number alone."""
        schedule, epoch = self.schedule, self.current_epoch
        rate = schedule.learning_rate * schedule.decay ** (epoch // schedule.decay_every)
        for group in self.trainer.optimizers[0].param_groups:
            group["lr"] = rate
        torch.manual_seed(self.config.seed * 1_000_003 + epoch)
        self._means = Means()
        self._started = time.perf_counter()

    def on_before_optimizer_step(self, optimizer: torch.optim.Optimizer) -> None:
        gradients = [p.grad for p in self.net.parameters() if p.grad is not None]
        norm = torch.nn.utils.get_total_norm(gradients)
        if not math.isfinite(norm.item()):
            self._fail("the gradient")
        self._means.add("gradient_norm", norm)
        if self.config.max_gradient_norm > 0:
            torch.nn.utils.clip_grads_with_norm_(
                self.net.parameters(), self.config.max_gradient_norm, norm
            )

    def on_train_epoch_end(self) -> None:
        seconds = time.perf_counter() - self._started
        scenes = self._means.count("scenes") * self.trainer.world_size
        if self.diagnostics is not None:
            for name, values in self.diagnostics.measure(self.net).items():
                self._means.add(name, values)
        means = self._result(self._means)
        if "loss" not in means:
            raise DmfcError(
                f"{self.task.stage}: no seed point of the {scenes} scenes matches a grasp, so there"
                " is nothing to learn (matching.mode, matching.distance, grasps.per_object)"
            )
        means["learning_rate"] = self.trainer.optimizers[0].param_groups[0]["lr"]
        timings = {"seconds": seconds, "scenes_per_second": scenes / seconds}
        self._add_row("train", means | timings)

    def _result(self, means: Means) -> dict[str, float]:
        result = means.result(lambda t: self.trainer.strategy.reduce(t, reduce_op="sum"))
        result.pop("scenes", None)
        return result

    def _add_row(self, split: str, means: dict[str, float]) -> None:
        head = {"stage": self.task.stage, "epoch": self.current_epoch, "split": split}
        self.metrics.append(head | means | {"time": round(time.time(), 3)})

    def on_save_checkpoint(self, checkpoint: dict[str, Any]) -> None:
        checkpoint["metrics"] = self.metrics
        checkpoint["data_digest"] = self.data_digest

    def on_load_checkpoint(self, checkpoint: dict[str, Any]) -> None:
        """Raises DmfcError for a checkpoint of a run on other data."""
        if checkpoint["data_digest"] != self.data_digest:
            raise DmfcError(
                f"the checkpoint of {self.task.stage} was made with other data: remove "
                f"{self.failure.file.parent} to start again"
            )
        self.metrics = checkpoint["metrics"]

    def _require_finite(self, terms: dict[str, Tensor], candidates: Candidates) -> None:
        checked = {**terms, "confidence": candidates.logit}
        if torch.stack([values.detach().isfinite().all() for values in checked.values()]).all():
            return
        for name, values in checked.items():
            bad = ~values.detach().isfinite()
            if bad.any():
                rows = candidates.scene[bad].unique()
                self._fail(f"the term '{name}'", rows)

    def _fail(self, what: str, rows: Tensor | None = None) -> None:
        """`rows`: where in the batch; None: anywhere."""
        batch = self._batch
        assert batch is not None
        self.failure.save(self.task, self.net, batch, what)
        scenes = (batch.scene_number if rows is None else batch.scene_number[rows]).tolist()
        listed = ", ".join(str(scene) for scene in scenes[:8])
        raise DmfcError(
            f"{self.task.stage} stopped in epoch {self.current_epoch}: {what} is not finite in "
            f"scene {listed}; `dmfc train --replay {self.failure.file}` shows "
            f"its terms (training.{self.task.stage}.learning_rate, training.max_gradient_norm)"
        )


def _push_down(logit: Tensor, batch: Batch) -> Tensor:
    """mean of -log(1 - c) over the seed points without a label; 0 where all have one."""
    negative = logit[~batch.match.any(-1)]
    return torch.nn.functional.softplus(negative).sum() / max(len(negative), 1)
