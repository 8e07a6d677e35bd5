"""Replays a finished evaluation: one trial exactly as it was, or a picture of all grasps."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dmfc.engine.ledger import Ledger
from dmfc.engine.stage import Stage
from dmfc.errors import DmfcError
from dmfc.pipeline.artifacts import load_trials
from dmfc.pipeline.stages import evaluation_of

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
    from dmfc.visualization.trials import DETAILED, STEPS, trial_strip

    number, trial = parse_trial(only)
    stage, evaluation, scene = find_scene(ledger, stages, number, "--only scene:trial")
    found = evaluation.chosen(scene, evaluation.proposals(scene))
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


def picture_dense(
    ledger: Ledger, stages: tuple[Stage, ...], number: int, path: Path
) -> dict[str, Any]:
    """Write a PNG of every grasp that is proposed in scene `number`, coloured by confidence.

    Returns how many there are, how many are executed, and the range of confidences. Raises
    DmfcError if there is no such scene, or no grasp in it.
    """
    from dmfc.visualization.dense import dense_picture

    _, evaluation, scene = find_scene(ledger, stages, number, "--dense scene")
    proposed = evaluation.proposals(scene)
    if not len(proposed):
        raise DmfcError(f"no grasp is proposed in scene {number}: nothing to picture")
    executed = evaluation.chosen(scene, proposed)
    dense_picture(scene.points, proposed, executed, evaluation.hand, path, f"scene {number}")
    return {
        "scene": number,
        "proposed": len(proposed),
        "executed": len(executed),
        "least_confidence": float(proposed.confidence.min()),
        "most_confidence": float(proposed.confidence.max()),
    }


def find_scene(
    ledger: Ledger, stages: tuple[Stage, ...], number: int, option: str
) -> tuple[Stage, Evaluation, Scene]:
    """The shard that has a scene, and the scene; raises DmfcError, naming `option`, if none has."""
    for stage in stages:
        evaluation = _evaluation(ledger, stage)
        for scene in evaluation.scenes:
            if scene.scene == number:
                return stage, evaluation, scene
    raise DmfcError(f"the test set has no scene {number} ({option})")


def _evaluation(ledger: Ledger, stage: Stage) -> Evaluation:
    return evaluation_of(stage.config, input_folders(ledger, stage.inputs), stage.hints)


def input_folders(
    ledger: Ledger, inputs: Mapping[str, Stage | tuple[Stage, ...]]
) -> dict[str, Path | list[Path]]:
    """The folders of finished inputs by name, whole. Raises DamagedError where one is not."""
    return {
        name: [ledger.verified(item.address) for item in given]
        if isinstance(given, tuple)
        else ledger.verified(given.address)
        for name, given in inputs.items()
    }


def _written(
    ledger: Ledger, stage: Stage, scene: int, trial: int, columns: list[str]
) -> dict[str, Any]:
    """What the evaluation wrote of a trial."""
    rows = load_trials(ledger.verified(stage.address)).set_index(["scene", "trial"])
    return rows.loc[(scene, trial), columns].to_dict()


def parse_trial(text: str, option: str = "--only") -> tuple[int, int]:
    """'3:0' as the numbers of a scene and of a trial in it."""
    scene, _, trial = text.partition(":")
    if not (scene.isdigit() and trial.isdigit()):
        raise DmfcError(f"{option} wants scene:trial, two numbers such as 3:0, not '{text}'")
    return int(scene), int(trial)
