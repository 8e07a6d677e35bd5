"""Executed grasps as a data set for others: rows, the scenes that they lie in, and a card."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import pandas as pd

from dmfc.errors import DmfcError
from dmfc.files.atomic import write_bytes, write_text

CARD, ROWS = "README.md", "executed.parquet"


def export_trials(files: Sequence[tuple[Path, Path]], out: Path, about: str) -> int:
    """Write pairs of rows and scenes as one data set into the folder `out`; gives its rows.

    `about`: what the card says of where they come from. Raises DmfcError where `out` is not empty.
    """
    if out.exists() and any(out.iterdir()):
        raise DmfcError(f"{out} is not empty: give a new folder (--out)")
    out.mkdir(parents=True, exist_ok=True)
    tables = []
    for number, (rows_file, scenes_file) in enumerate(files):
        name = f"scenes-{number:04d}.parquet"
        tables.append(pd.read_parquet(rows_file).assign(scenes_file=name))
        write_bytes(out / name, scenes_file.read_bytes())
    rows = pd.concat(tables, ignore_index=True)
    rows.to_parquet(out / ROWS, index=False)
    write_text(out / CARD, _card(rows, len(files), about))
    return len(rows)


def _card(rows: pd.DataFrame, shards: int, about: str) -> str:
    by_choice = rows.groupby("choice").agg(
        trials=("held", "size"), planned=("planned", "mean"), held=("held", "mean")
    )
    table = "\n".join(
        f"| {choice} | {row.trials:.0f} | {row.planned:.2f} | {row.held:.2f} |"
        for choice, row in by_choice.iterrows()
    )
    joints = sum(str(name).startswith("joint_") for name in rows)
    return f"""# Executed grasps

{about}

| choice | trials | planned | held |
|---|---|---|---|
{table}

{len(rows)} trials of {rows["object"].nunique()} objects in {shards} files of scenes. `{ROWS}` has a
row per trial: `scenes_file` and `scene` name its scene, `object_index` the object in it that was to
be grasped, `seed_point` the point of its cloud that the grasp was proposed at. The palm's pose is
`palm_x`, `palm_y`, `palm_z` (metres) and the unit quaternion `palm_qw` to `palm_qz`, in the world,
z up, table at z = 0; `joint_00` to `joint_{joints - 1:02d}` are the joint angles in rad. What
became of it: `planned`, `held`, `reason`, and the measurements that docs/execution.md explains.
`choice` says why it was executed: at random among those clear of the cloud, as one of the most
confident, or although the cloud is in its way. Scenes are read with
`dmfc.scenes.scene_set.SceneSet`.

Simulated (MuJoCo), not tried on a real hand. Licence: Apache-2.0; objects keep their own.
"""
