"""The verb that trains one model."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from dmfc.cli.common import PRESET, STORE, AsJson, Overrides, Preset, Store
from dmfc.experiment.console import answer, show_rows
from dmfc.experiment.session import Session
from dmfc.experiment.training import train_model, training_stage

if TYPE_CHECKING:
    from dmfc.engine.stage import Stage


def train(
    stage: Annotated[
        str,
        typer.Option("--stage", help="pretrain, or finetune (which pretrains first if necessary)."),
    ] = "finetune",
    preset: Preset = PRESET,
    overrides: Overrides = None,
    store: Store = STORE,
    as_json: AsJson = False,
    replay: Annotated[
        Path | None,
        typer.Option(help="A batch that stopped a run: print its terms instead of training."),
    ] = None,
) -> None:
    """Train a model, after making its inputs, and print its last epoch."""
    session = Session.open(preset, overrides, store)
    if replay is not None:
        _replay_batch(session, training_stage(session, stage), replay, as_json)
        return
    model = train_model(session, stage)
    if as_json:
        answer({"stage": model.address, "folder": str(model.folder), "metrics": model.epochs})
        return
    last = {line["split"]: line for line in model.epochs}
    rows = [{"metric": name, "value": v} for line in last.values() for name, v in line.items()]
    show_rows(f"{stage}: last epoch", rows, as_json=False)
    typer.echo(f"weights and metrics: {model.folder}")


def _replay_batch(session: Session, training: Stage, file: Path, as_json: bool) -> None:
    from dmfc.pipeline.replay_batch import batch_stages, replay_batch
    from dmfc.training.failure import read_failure

    read_failure(file)  # before the stages are made that it is replayed with
    needed = batch_stages(training).values()
    session.make([s for given in needed for s in (given if isinstance(given, tuple) else (given,))])
    what, rows = replay_batch(session.ledger, training, file)
    show_rows(f"{file}: {what} was not finite", rows, as_json)
