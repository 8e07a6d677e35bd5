"""Trains an outcome predictor on executed grasps, from start or from its last checkpoint."""

from __future__ import annotations

import contextlib
import logging
import os
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import torch
from lightning.pytorch import LightningModule, Trainer
from lightning.pytorch.callbacks import Checkpoint
from torch import Tensor
from torch.nn.functional import binary_cross_entropy_with_logits

from dmfc.config.outcome import OutcomeConfig
from dmfc.errors import DmfcError
from dmfc.outcome.calibration import platt
from dmfc.outcome.network import OutcomeNet
from dmfc.outcome.report import Report, report
from dmfc.outcome.trials import Trials

Progress = Callable[[float, str], None]
CHECKPOINT = "last.ckpt"
NEVER = 1e9
"""Scale of a feature that no trial has: it is 0 whatever it is."""


def fit(
    trials: Trials,
    config: OutcomeConfig,
    seed: int,
    work: Path,
    progress: Progress = lambda fraction, message: None,
) -> tuple[OutcomeNet, Report]:
    """The trained, calibrated predictor, and how well it does on objects that it did not see.

    Member k learns without fold k of the objects, which is what it is calibrated and measured on.
    Every object counts alike. A second call with the same `work` goes on after the last finished
    epoch, and ends as the uninterrupted run would have.
    """
    fold = folds(trials.object, config.members, seed)
    torch.manual_seed(seed)
    net = OutcomeNet(trials.features.shape[1], config.widths, config.members, config.dropout)
    _normalise(net, trials.features)
    module = _Module(net, trials, fold, config, seed)
    work.mkdir(parents=True, exist_ok=True)
    checkpoint = work / CHECKPOINT
    with _quiet():
        trainer = Trainer(
            max_epochs=config.epochs,
            accelerator="cpu",
            callbacks=[_KeepLast(checkpoint, progress)],
            logger=False,
            enable_progress_bar=False,
            enable_model_summary=False,
            default_root_dir=work,
            reload_dataloaders_every_n_epochs=1,
        )
        there = checkpoint if checkpoint.exists() else None
        trainer.fit(module, ckpt_path=there, weights_only=True)
    if trainer.current_epoch < config.epochs:
        raise DmfcError(
            f"outcome was interrupted after {trainer.current_epoch} of {config.epochs} epochs; "
            "run it again to go on"
        )
    return net.eval(), _calibrated(net, trials, fold)


def folds(objects: np.ndarray, members: int, seed: int) -> np.ndarray:
    """[n] which member does not learn from the trials of an object [n]; sizes differ by one."""
    names = np.unique(objects.astype(str))
    if len(names) < members:
        raise DmfcError(
            f"{len(names)} objects for {members} networks that each leave some out: "
            "more objects (outcome.objects) or fewer networks (outcome.members)"
        )
    number = np.random.default_rng(seed).permutation(len(names)) % members
    return number[np.searchsorted(names, objects.astype(str))]


def object_weights(objects: np.ndarray) -> np.ndarray:
    """[n] such that every object's trials weigh alike, 1 on average."""
    _, which, counts = np.unique(objects.astype(str), return_inverse=True, return_counts=True)
    return len(objects) / len(counts) / counts[which]


def _normalise(net: OutcomeNet, features: np.ndarray) -> None:
    with np.errstate(invalid="ignore"), warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # a feature that is never known
        mean, scale = np.nanmean(features, 0), np.nanstd(features, 0)
    net.mean.copy_(torch.from_numpy(np.nan_to_num(mean)))
    # What was never known in training must not matter later, where it may be known.
    net.scale.copy_(torch.from_numpy(np.maximum(np.nan_to_num(scale, nan=NEVER), 1e-6)))


@torch.no_grad()
def _calibrated(net: OutcomeNet, trials: Trials, fold: np.ndarray) -> Report:
    """Set the calibration of `net` by what each member says of its own fold; report the same."""
    every = net.logits(net.normalise(torch.from_numpy(trials.features))).double().numpy()
    unseen = every[fold, np.arange(len(trials))]
    weight = object_weights(trials.object)
    # Those that the cloud is in the way of are refused anyway: what is said is of the others.
    clear, rows = trials.clear, trials.clear & trials.planned
    planned = platt(unseen[clear, 0], trials.planned[clear], weight[clear])
    held = platt(unseen[rows, 1], trials.held[rows], weight[rows])
    net.slope.copy_(torch.tensor([planned[0], held[0]]))
    net.shift.copy_(torch.tensor([planned[1], held[1]]))
    said = 1 / (1 + np.exp(-(unseen * net.slope.numpy() + net.shift.numpy())))
    return report(said[:, 0], said[:, 1], trials)


class _Module(LightningModule):
    """Cross-entropy of both logits, each member's without its own fold."""

    def __init__(
        self, net: OutcomeNet, trials: Trials, fold: np.ndarray, config: OutcomeConfig, seed: int
    ) -> None:
        super().__init__()
        self.net, self.config, self.seed = net, config, seed
        self._rows = (
            net.normalise(torch.from_numpy(trials.features)),
            torch.from_numpy(trials.planned.astype(np.float32)),
            torch.from_numpy(trials.held.astype(np.float32)),
            torch.from_numpy(object_weights(trials.object).astype(np.float32)),
            torch.from_numpy(fold),
        )

    def train_dataloader(self) -> _Batches:
        # Requested again in every epoch.
        seed = self.seed * 100_003 + self.current_epoch
        return _Batches(len(self._rows[0]), self.config.batch_size, seed)

    def on_train_epoch_start(self) -> None:
        # An epoch depends on its number alone, so that one which follows a checkpoint is the same.
        torch.manual_seed(self.seed * 100_003 + self.current_epoch)

    def training_step(self, batch: Tensor, batch_idx: int) -> Tensor:
        normal, planned, held, weight, fold = (values[batch] for values in self._rows)
        members = self.net.members
        rows = normal.expand(members, *normal.shape)
        rows = rows + self.config.noise * torch.randn_like(rows)
        logits = self.net.logits(rows)
        others = (fold != torch.arange(members)[:, None]).float() * weight
        fits = binary_cross_entropy_with_logits(
            logits[..., 0], planned.expand(members, -1), reduction="none"
        )
        holds = binary_cross_entropy_with_logits(
            logits[..., 1], held.expand(members, -1), reduction="none"
        )
        return ((fits + holds * planned) * others).sum() / len(batch)

    def configure_optimizers(self) -> Any:
        config = self.config
        optimizer = torch.optim.AdamW(
            self.net.parameters(), lr=config.learning_rate, weight_decay=config.weight_decay
        )
        steps = config.epochs * len(self.train_dataloader())
        schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, steps)
        return {"optimizer": optimizer, "lr_scheduler": {"scheduler": schedule, "interval": "step"}}


class _Batches:
    """Rows of each batch of an epoch, in an order that follows from a seed, all but a rest."""

    def __init__(self, count: int, size: int, seed: int) -> None:
        self.count, self.size, self.seed = count, min(size, count), seed

    def __len__(self) -> int:
        return self.count // self.size

    def __iter__(self) -> Iterator[Tensor]:
        generator = torch.Generator().manual_seed(self.seed)
        order = torch.randperm(self.count, generator=generator)
        return iter(order[: len(self) * self.size].split(self.size))


class _KeepLast(Checkpoint):
    """Saves after each epoch, whole or not at all, and tells how far it is."""

    def __init__(self, path: Path, progress: Progress) -> None:
        self.path, self.progress = path, progress

    def on_train_epoch_end(self, trainer: Trainer, pl_module: LightningModule) -> None:
        temporary = self.path.with_suffix(".part")
        trainer.save_checkpoint(temporary)
        os.replace(temporary, self.path)
        epoch, epochs = trainer.current_epoch + 1, int(trainer.max_epochs or 1)
        self.progress(epoch / epochs, f"outcome epoch {epoch}/{epochs}")


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Lightning's greetings and advice on loaders are not for the users of a stage."""
    logger = logging.getLogger("lightning.pytorch")
    level = logger.level
    logger.setLevel(logging.WARNING)
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", module="lightning")
        try:
            yield
        finally:
            logger.setLevel(level)
