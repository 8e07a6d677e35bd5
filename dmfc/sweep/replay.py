"""One trial of a finished evaluation once more, exactly as it was, and a picture of it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from dmfc.errors import DmfcError
from dmfc.sweep.ledger import Ledger
from dmfc.sweep.stage import Stage
from dmfc.sweep.stages import evaluation_of

if TYPE_CHECKING:
    from dmfc.execution.trial import Outcome


def replay(ledger: Ledger, stages: tuple[Stage, ...], only: str, picture: Path) -> Outcome:
    """Run trial `only` ('scene:trial') of the evaluations `stages` and write its strip as PNG.

    Raises DmfcError if there is no such trial, or no grasp in it.
    """
    from dmfc.execution.picture import trial_strip

    scene_number, trial = _parse(only)
    for stage in stages:
        inputs: dict[str, Path | list[Path]] = {
            name: [ledger.folder(item.address) for item in given]
            if isinstance(given, tuple)
            else ledger.folder(given.address)
            for name, given in stage.inputs.items()
        }
        evaluation = evaluation_of(stage.config, inputs)
        for scene in evaluation.scenes:
            if scene.scene != scene_number:
                continue
            found = evaluation.candidates(scene)
            if not 0 <= trial < len(found):
                raise DmfcError(f"scene {scene_number} has {len(found)} grasps, no trial {trial}")
            image, outcome = trial_strip(evaluation.open(scene, visual=True), found, trial)
            picture.parent.mkdir(parents=True, exist_ok=True)
            image.save(picture)
            return outcome
    raise DmfcError(f"the test set has no scene {scene_number} (--only scene:trial)")


def _parse(only: str) -> tuple[int, int]:
    scene, _, trial = only.partition(":")
    if not (scene.isdigit() and trial.isdigit()):
        raise DmfcError(f"--only wants scene:trial, two numbers such as 3:0, not '{only}'")
    return int(scene), int(trial)
