"""The method of an evaluation stage: a function in a file, or answers that were kept."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dmfc.config.custom_function import custom_function
from dmfc.pipeline.graph_method import ANSWERS, METHOD
from dmfc.pipeline.here import require_same

if TYPE_CHECKING:
    from dmfc.execution.evaluate import Method
    from dmfc.hand.model import HandModel
    from dmfc.scenes.scene_set import Scene, SceneSet


def method_of(
    config: Mapping[str, Any], hints: Mapping[str, str], scenes: SceneSet, hand: HandModel
) -> Method | None:
    """What answers for the scenes of a shard; None for rows of another kind.

    Raises MachineError where its file or its answers are not those of the plan.
    """
    from dmfc.methods.ask import Answered, ask
    from dmfc.methods.kept import answers_digest, left_out, load_answers
    from dmfc.methods.observation import observe

    manifest = scenes.manifests[0]
    if config["row"] == METHOD:
        function = custom_function(hints["method"], "model")
        require_same(f"model: the file of '{hints['method']}'", function.digest, config["method"])
        predict = function.load()
        return lambda scene: ask(predict, observe(scene, hand, manifest))
    if config["row"] != ANSWERS:
        return None
    folder = Path(hints["answers"])
    answers = load_answers(folder, len(hand.dof_names))
    require_same(str(folder), answers_digest(answers)[: len(folder.name)], config["answers"])

    def answered(scene: Scene) -> Answered:
        return answers.get(observe(scene, hand, manifest).id, left_out(len(hand.dof_names)))

    return answered
