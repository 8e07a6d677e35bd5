"""Executed grasps as training data of a predictor: features, outcomes, and objects."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.spatial.transform import Rotation

from dmfc.errors import DmfcError
from dmfc.outcome.features import FeatureMaker, SeededGrasps
from dmfc.scenes.scene_set import SceneSet

POSITION = ("palm_x", "palm_y", "palm_z")
"""Columns of the palm's origin, world frame, metres."""
QUATERNION = ("palm_qw", "palm_qx", "palm_qy", "palm_qz")
"""Columns of R_world_palm as a unit quaternion, w >= 0."""


def joint_columns(dofs: int) -> list[str]:
    """Names of the columns of the joint angles, rad, in the order of the hand's."""
    return [f"joint_{k:02d}" for k in range(dofs)]


def grasps_of(rows: pd.DataFrame) -> SeededGrasps:
    """The grasps of rows of a trial table that have one."""
    joints = [name for name in rows if str(name).startswith("joint_")]
    turn = np.roll(rows[list(QUATERNION)].to_numpy(np.float64), -1, axis=1)
    return SeededGrasps(
        position=rows[list(POSITION)].to_numpy(np.float64),
        rotation=Rotation.from_quat(turn).as_matrix().reshape(-1, 3, 3),
        joints=rows[joints].to_numpy(np.float64),
        seed_point=rows["seed_point"].to_numpy(np.int64),
        confidence=rows["confidence"].to_numpy(np.float64),
    )


@dataclass(frozen=True)
class Trials:
    """n executed grasps."""

    features: np.ndarray
    """[n, F] float32."""
    planned: np.ndarray
    """[n] bool."""
    held: np.ndarray
    """[n] bool; never where it was not planned."""
    object: np.ndarray
    """[n] names of the objects that were to be grasped."""
    scene: np.ndarray
    """[n] a number for each scene."""
    clear: np.ndarray
    """[n] bool: those that the cloud is not in the way of, which a predictor has to rank."""

    def __len__(self) -> int:
        return len(self.planned)

    def __getitem__(self, rows: np.ndarray) -> Trials:
        return Trials(*(getattr(self, entry.name)[rows] for entry in fields(self)))

    @classmethod
    def of(cls, parts: Sequence[Trials]) -> Trials:
        """One after the other. Raises DmfcError where there are none, or all ended alike."""
        if not parts:
            raise DmfcError("no grasp was executed: nothing to learn from (outcome.rollouts)")
        names = [entry.name for entry in fields(cls)]
        trials = cls(*(np.concatenate([getattr(t, name) for t in parts]) for name in names))
        if trials.held.all() or not trials.held.any():
            raise DmfcError(
                f"all {len(trials)} executed grasps ended alike: nothing to learn "
                "(outcome.rollouts)"
            )
        return trials


def read_trials(
    files: Sequence[tuple[Path, Path]],
    features: FeatureMaker,
    progress: Callable[[float, str], None] = lambda fraction, message: None,
) -> Trials:
    """Trials of pairs of files: rows (`rollouts.parquet`) and the scenes that they lie in.

    Raises DmfcError where there is none, or none of one kind: then nothing can be learned.
    """
    found: list[Trials] = []
    for done, (rows_file, scenes_file) in enumerate(files, start=1):
        table = pd.read_parquet(rows_file)
        for scene in SceneSet.open([scenes_file]) if len(table) else ():
            rows = table[table["scene"] == scene.scene]
            if len(rows):
                made = features(grasps_of(rows), scene.points)
                found.append(trials_of(made, rows, len(found)))
        progress(done / len(files), f"features of {rows_file.parent.name}")
    return Trials.of(found)


def trials_of(features: np.ndarray, rows: pd.DataFrame, scene: int) -> Trials:
    """Rows of one scene, with what is known of each grasp [n, F]; the scene gets a number."""
    return Trials(
        features,
        rows["planned"].to_numpy(bool),
        rows["held"].to_numpy(bool),
        rows["object"].to_numpy(str).astype(object),
        np.full(len(rows), scene),
        (rows["choice"] != "refused").to_numpy(bool),
    )
