"""Replays a batch that stopped a training, with the hand and the objects of a store."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from dmfc.engine.ledger import Ledger
from dmfc.engine.stage import Stage
from dmfc.pipeline.replay import input_folders
from dmfc.pipeline.stages_training import training_geometry


def batch_stages(training: Stage) -> dict[str, Stage | tuple[Stage, ...]]:
    """The inputs of a training stage that `replay_batch` needs."""
    needed = ("hand", "objects", "validation_objects")
    return {name: given for name, given in training.inputs.items() if name in needed}


def replay_batch(ledger: Ledger, training: Stage, file: Path) -> tuple[str, list[dict[str, Any]]]:
    """What stopped the run that saved a batch in `file`, and the terms of that batch.

    `training`: a stage with the hand and the objects of that run.
    """
    from dmfc.training.failure import read_failure
    from dmfc.training.replay import replay

    saved = read_failure(file)
    hand, atlas = training_geometry(input_folders(ledger, batch_stages(training)))
    return saved["what"], replay(saved, hand, atlas)
