"""A batch that stopped a run, saved with everything needed to compute its losses again."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import torch
from omegaconf import OmegaConf

from dmfc.errors import DmfcError
from dmfc.files.atomic import written_whole
from dmfc.files.foreign import reading
from dmfc.network.model import DmfcGraspNet
from dmfc.training.batch import Batch
from dmfc.training.settings import FitConfig
from dmfc.training.task import Task

VERSION = 2
ENTRIES = {"version", "what", "stage", "hand", "objects", "config", "batch", "weights"}


@dataclass(frozen=True)
class Failure:
    """Where a failing batch is saved, and the settings that are saved with it."""

    file: Path
    config: FitConfig
    hand: str

    def save(self, task: Task, net: DmfcGraspNet, batch: Batch, what: str) -> None:
        """Write the batch, the weights before the step, and what was not finite."""
        settings = OmegaConf.to_container(OmegaConf.structured(self.config))
        self.file.parent.mkdir(parents=True, exist_ok=True)
        values = {
            "version": VERSION,
            "what": what,
            "stage": task.stage,
            "hand": self.hand,
            "objects": task.atlas.ids,
            "config": json.dumps(settings),
            "batch": batch.to("cpu").tensors(),
            "weights": {name: value.cpu() for name, value in net.state_dict().items()},
        }
        with written_whole(self.file) as temporary:
            torch.save(values, temporary)


def read_failure(path: Path) -> dict[str, Any]:
    """What `Failure.save` wrote; nothing in it can run code. Raises DmfcError for another file."""
    with reading(path, "a saved batch", "--replay"):
        found = torch.load(path, weights_only=True, map_location="cpu")
    if not isinstance(found, dict) or set(found) != ENTRIES or found["version"] != VERSION:
        raise DmfcError(f"{path} is not a batch that this version of dmfc saved")
    return cast(dict[str, Any], found)
