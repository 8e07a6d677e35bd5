"""One stage of training from start, or from its last checkpoint, to a folder of results."""

from __future__ import annotations

import contextlib
import json
import logging
import time
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import torch
from lightning.pytorch import Callback, LightningDataModule, LightningModule, Trainer
from lightning.pytorch.callbacks import Checkpoint
from omegaconf import OmegaConf
from safetensors.torch import save_file

from dmfc.config.custom_function import custom_class, is_custom
from dmfc.errors import DmfcError
from dmfc.files.atomic import write_bytes, write_text
from dmfc.hand.model import HandModel
from dmfc.network.checkpoint import load_weights, new_network, require_finite
from dmfc.network.model_files import BACKBONE, CONFIG, METRICS, SUMMARY, WEIGHTS
from dmfc.objects.atlas import ObjectAtlas
from dmfc.training.batch import Batch
from dmfc.training.diagnostics import Diagnostics
from dmfc.training.failure import Failure
from dmfc.training.module import GraspTraining
from dmfc.training.resume import keep_checkpoint, last_checkpoint
from dmfc.training.settings import FitConfig
from dmfc.training.task import Stage, Task
from dmfc.training.validation import Validation

VERSION = 1
PART = "checkpoint.part"
FAILURE = "failure.pt"


def fit(
    stage: Stage,
    config: FitConfig,
    hand: HandModel,
    data: LightningDataModule,
    atlas: ObjectAtlas,
    out: Path,
    work: Path,
    init_weights: Path | None = None,
    data_digest: str = "",
    probe: Batch | None = None,
    progress: Callable[[float, str], None] = lambda fraction, message: None,
) -> None:
    """Train `stage` and write weights, metrics per epoch, config and summary into `out`.

    `init_weights`: folder of a finished stage to start from; None starts from random weights, which
    follow from the seed. `data_digest` tells the data from others: a checkpoint of other data is
    refused. `probe`: scenes on which fine-tuning is diagnosed. `work` holds a checkpoint per epoch:
    a second call with the same `work` goes on after the last finished epoch, and ends as the
    uninterrupted run would have.
    Raises DmfcError where a loss or a weight is not finite or nothing can be learned.
    """
    training = config.training
    work.mkdir(parents=True, exist_ok=True)
    torch.manual_seed(training.seed)
    net = new_network(config.network, hand)
    if init_weights is not None:
        load_weights(net, init_weights)
    points, seeds = training.rank_points, training.finetune_seeds
    task = Task(stage, config.losses, hand, atlas, points, seeds, config.approach)
    if stage == "finetune" and training.finetune_form == "projected" and not task.of_scene:
        raise DmfcError(
            "training.finetune_form=projected has no term to move predictions by: every one of "
            "losses.weights but chamfer is 0"
        )
    failure = Failure(work / FAILURE, config, hand.name)
    validation = Validation(config.validation, config.losses, hand, atlas, config.approach)
    diagnostics = None
    if probe is not None and stage == "finetune" and task.of_scene:
        diagnostics = Diagnostics(net, task, probe, training.projection)
    module = GraspTraining(net, task, training, failure, validation, diagnostics)
    module.data_digest = data_digest
    started = time.perf_counter()
    with _quiet(), _threads(training.threads):
        trainer = Trainer(
            max_epochs=module.schedule.epochs,
            accelerator=training.accelerator,
            devices=training.devices,
            precision=training.precision,
            callbacks=[_KeepLast(work), _Progress(stage, progress)],
            logger=False,
            enable_progress_bar=False,
            enable_model_summary=False,
            default_root_dir=work,
            num_sanity_val_steps=0,
            check_val_every_n_epoch=config.validation.every,
            use_distributed_sampler=False,  # the data module's sampler knows the processes
        )
        with _interrupts_raised():
            trainer.fit(
                module,
                datamodule=data,
                ckpt_path=last_checkpoint(work),
                weights_only=True,
            )
    finished = sum(row["split"] == "train" for row in module.metrics)
    if finished < module.schedule.epochs:
        raise DmfcError(
            f"{stage} was interrupted after {finished} of {module.schedule.epochs} epochs; "
            "run it again to go on"
        )
    if trainer.is_global_zero:
        _write(out, stage, config, module, hand, time.perf_counter() - started)


@contextlib.contextmanager
def _interrupts_raised() -> Iterator[None]:
    """Lightning ends the program on Ctrl-C; who called is to say how to go on."""
    try:
        yield
    except SystemExit as ended:
        if isinstance(ended.__context__, KeyboardInterrupt):
            raise KeyboardInterrupt from ended
        raise


def _write(
    out: Path, stage: str, config: FitConfig, module: GraspTraining, hand: HandModel, seconds: float
) -> None:
    out.mkdir(parents=True, exist_ok=True)
    state = {k: v.detach().cpu().contiguous() for k, v in module.net.state_dict().items()}
    require_finite(state, f"the weights after {stage}")
    save_file(state, out / WEIGHTS)
    _write_metrics(out / METRICS, module)
    if is_custom(config.network.backbone):
        source = custom_class(config.network.backbone, "network.backbone").file
        write_bytes(out / BACKBONE, source.read_bytes())
    described = OmegaConf.create({"version": VERSION, "stage": stage, "hand": hand.name})
    settings = OmegaConf.to_container(OmegaConf.structured(config))
    OmegaConf.save(OmegaConf.merge(described, settings), out / CONFIG)
    summary: dict[str, Any] = {
        "version": VERSION,
        "stage": stage,
        "epochs": module.schedule.epochs,
        "parameters": sum(p.numel() for p in module.net.parameters()),
        "seconds": round(seconds, 3),
        "data_digest": module.data_digest,
        "device": str(module.device),
        "torch": torch.__version__,
        "last": {row["split"]: row for row in module.metrics},
    }
    write_text(out / SUMMARY, json.dumps(summary, indent=1) + "\n")


def _write_metrics(path: Path, module: GraspTraining) -> None:
    lines = [json.dumps(row) + "\n" for row in module.metrics]
    write_text(path, "".join(lines))


class _KeepLast(Checkpoint):
    """Saves after each epoch, whole or not at all, and then its metrics, for those who watch.

    A `Checkpoint`, because Lightning calls those after the module's own hook has added its metrics.
    """

    def __init__(self, work: Path) -> None:
        self.work = work

    def on_train_epoch_end(self, trainer: Trainer, pl_module: LightningModule) -> None:
        temporary = self.work / PART
        trainer.save_checkpoint(temporary)  # by all processes together
        if trainer.is_global_zero:
            keep_checkpoint(temporary)
            assert isinstance(pl_module, GraspTraining)
            _write_metrics(self.work / METRICS, pl_module)


class _Progress(Callback):
    """Tells the fraction of all steps done after each."""

    def __init__(self, stage: str, tell: Callable[[float, str], None]) -> None:
        self.stage = stage
        self.tell = tell

    def on_train_batch_end(self, trainer: Trainer, pl_module: LightningModule, *_: Any) -> None:
        steps = int(trainer.num_training_batches)
        epochs = int(trainer.max_epochs or 1)
        done = trainer.current_epoch + (trainer.fit_loop.batch_idx + 1) / max(steps, 1)
        self.tell(done / epochs, f"{self.stage} epoch {trainer.current_epoch + 1}/{epochs}")


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


@contextlib.contextmanager
def _threads(count: int) -> Iterator[None]:
    before = torch.get_num_threads()
    torch.set_num_threads(count)
    try:
        yield
    finally:
        torch.set_num_threads(before)
