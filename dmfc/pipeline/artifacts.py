"""Every artifact that a stage leaves: the name of its file, and how it is read.

A loader takes the folder of a finished stage (`Ledger.verified`) and raises DmfcError where the
file is missing or damaged. It imports what it needs when it is called.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dmfc.engine.record import read_record
from dmfc.errors import DmfcError, first_line
from dmfc.execution.trial_files import DIVERSITY, TRIALS
from dmfc.network.model_files import CONFIG, METRICS, SUMMARY, WEIGHTS

if TYPE_CHECKING:
    import pandas as pd

    from dmfc.config.closing import ClosingConfig
    from dmfc.grasps.grasp_set import GraspSet
    from dmfc.hand.model import HandModel
    from dmfc.objects.model import ObjectModel
    from dmfc.scenes.scene_set import SceneSet

__all__ = ["CONFIG", "DIVERSITY", "METRICS", "SUMMARY", "TRIALS", "WEIGHTS"]

HAND = "hand.npz"
OBJECT = "object.npz"
GRASPS = "grasps.parquet"
SCENES = "scenes.parquet"
SCENE_COUNTS = "counts.json"
"""Scenes, labels and dropped labels of a shard."""


def load_hand(folder: Path, closing: ClosingConfig | None = None) -> HandModel:
    """The hand of a stage 'hand', whose fingers close as `closing` says (None: by default)."""
    from dmfc.hand.model import HandModel

    return HandModel.load(folder / HAND, closing)


def load_object(folder: Path) -> ObjectModel:
    """The prepared object of a stage 'object'."""
    from dmfc.objects.model import ObjectModel

    return ObjectModel.load(folder / OBJECT)


def load_grasps(folder: Path) -> GraspSet:
    """The grasp set of a stage 'grasps'."""
    from dmfc.grasps.grasp_set import GraspSet

    return GraspSet.load(folder / GRASPS)


def load_grasp_sets(folders: Iterable[Path]) -> dict[str, GraspSet]:
    """The grasp sets of several stages 'grasps', by the id of their object."""
    return {found.object_id: found for found in map(load_grasps, folders)}


def load_scenes(folders: Iterable[Path]) -> SceneSet:
    """The scenes of the shards, in their order."""
    from dmfc.scenes.scene_set import SceneSet

    return SceneSet.open([folder / SCENES for folder in folders])


def load_metrics(folder: Path) -> list[dict[str, Any]]:
    """What a training stage measured: a row per epoch and split."""
    path = folder / METRICS
    try:
        return [json.loads(line) for line in path.read_text().splitlines()]
    except (OSError, ValueError) as error:
        raise DmfcError(f"metrics '{path}' cannot be read: {first_line(error)}") from error


def load_trials(folder: Path, columns: list[str] | None = None) -> pd.DataFrame:
    """The rows of an evaluation's trials, or of some of their columns."""
    return _load_rows(folder / TRIALS, columns)


def load_diversity(folder: Path) -> pd.DataFrame:
    """How different the grasps of each scene of an evaluation are."""
    return _load_rows(folder / DIVERSITY)


def _load_rows(path: Path, columns: list[str] | None = None) -> pd.DataFrame:
    import pandas as pd

    try:
        return pd.read_parquet(path, columns=columns)
    except (OSError, ValueError) as error:
        raise DmfcError(f"rows '{path}' cannot be read: {first_line(error)}") from error


class Objects(Mapping[str, "ObjectModel"]):
    """Prepared objects by id, each loaded when it is asked for.

    The ids are read from the stages' records, so a scene of one object loads one object.
    """

    def __init__(self, folders: Iterable[Path]) -> None:
        self._folders = {read_record(folder)["config"]["object"]: folder for folder in folders}
        self._loaded: dict[str, ObjectModel] = {}

    def __getitem__(self, object_id: str) -> ObjectModel:
        if object_id not in self._loaded:
            self._loaded[object_id] = load_object(self._folders[object_id])
        return self._loaded[object_id]

    def __iter__(self) -> Iterator[str]:
        return iter(self._folders)

    def __len__(self) -> int:
        return len(self._folders)
