"""One trial of a finished evaluation once more, exactly as it was, with pictures of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dmfc.errors import DmfcError
from dmfc.sweep.ledger import Ledger
from dmfc.sweep.stage import Stage
from dmfc.sweep.stages import evaluation_of

if TYPE_CHECKING:
    from dmfc.execution.evaluate import Evaluation
    from dmfc.scenes.scene_set import Scene


@dataclass(frozen=True)
class Pictures:
    """What a replay leaves besides its row."""

    strip: Path
    """PNG with the steps side by side."""
    video: Path | None = None
    """GIF of the whole trial."""
    detailed: bool = False
    """More steps in the strip."""


def replay(
    ledger: Ledger, stages: tuple[Stage, ...], only: str, pictures: Pictures
) -> dict[str, Any]:
    """Run trial `only` ('scene:trial') of the finished evaluations `stages` and picture it.

    Returns the columns of its row, and `same`: whether they are those that the evaluation wrote.
    Raises DmfcError if there is no such trial, or no grasp in it.
    """
    from dmfc.execution.candidates import select
    from dmfc.execution.picture import DETAILED, STEPS, trial_strip

    number, trial = _parse(only)
    for stage in stages:
        evaluation = _evaluation(ledger, stage)
        scene = _scene(evaluation, number)
        if scene is None:
            continue
        found = select(evaluation.proposals(scene), evaluation.config)
        if not 0 <= trial < len(found):
            raise DmfcError(f"scene {number} has {len(found)} grasps, no trial {trial}")
        image, outcome = trial_strip(
            evaluation.open(scene, visual=True),
            found,
            trial,
            moments=DETAILED if pictures.detailed else STEPS,
            video=pictures.video,
        )
        pictures.strip.parent.mkdir(parents=True, exist_ok=True)
        image.save(pictures.strip)
        row = outcome.row()
        return {**row, "same": row == _written(ledger, stage, number, trial, list(row))}
    raise DmfcError(f"the test set has no scene {number} (--only scene:trial)")


def _evaluation(ledger: Ledger, stage: Stage) -> Evaluation:
    return evaluation_of(stage.config, input_folders(ledger, stage.inputs), stage.hints)


def input_folders(
    ledger: Ledger, inputs: Mapping[str, Stage | tuple[Stage, ...]]
) -> dict[str, Path | list[Path]]:
    """The folders of finished inputs, by name."""
    return {
        name: [ledger.folder(item.address) for item in given]
        if isinstance(given, tuple)
        else ledger.folder(given.address)
        for name, given in inputs.items()
    }


def _scene(evaluation: Evaluation, number: int) -> Scene | None:
    return next((scene for scene in evaluation.scenes if scene.scene == number), None)


def _written(
    ledger: Ledger, stage: Stage, scene: int, trial: int, columns: list[str]
) -> dict[str, Any]:
    """What the evaluation wrote of a trial."""
    import pandas as pd

    from dmfc.execution.evaluate import TRIALS

    rows = pd.read_parquet(ledger.folder(stage.address) / TRIALS).set_index(["scene", "trial"])
    return rows.loc[(scene, trial), columns].to_dict()


def _parse(only: str) -> tuple[int, int]:
    scene, _, trial = only.partition(":")
    if not (scene.isdigit() and trial.isdigit()):
        raise DmfcError(f"--only wants scene:trial, two numbers such as 3:0, not '{only}'")
    return int(scene), int(trial)
