"""The view of a scene of an evaluation, and of a trial in it."""

from __future__ import annotations

import numpy as np

from dmfc.errors import DmfcError
from dmfc.execution.candidates import GraspCandidates
from dmfc.execution.evaluate import Evaluation
from dmfc.scenes.scene_set import Scene
from dmfc.view.data import View, scene_view
from dmfc.view.record import record_trial


def evaluated_view(evaluation: Evaluation, scene: Scene, trial: int | None, source: str) -> View:
    """A scene with all grasps that `source` proposes in it, and the trial of one of them.

    A grasp that could not be planned is shown without motion. Raises DmfcError if nothing is
    proposed, or there is no such trial.
    """
    proposed = evaluation.proposals(scene)
    if not len(proposed):
        raise DmfcError(f"no grasp is proposed in scene {scene.scene}: nothing to view")
    objects = [evaluation.objects[name] for name in scene.object_ids]
    title = f"scene {scene.scene}, {source}"
    if trial is None:
        return scene_view(scene, objects, proposed, evaluation.hand, title)
    executed = evaluation.chosen(scene, proposed)
    if not 0 <= trial < len(executed):
        raise DmfcError(f"scene {scene.scene} has {len(executed)} grasps, no trial {trial}")
    name = f"trial {scene.scene}:{trial}"
    motion = record_trial(evaluation.open(scene), evaluation.hand, executed, trial, name)
    which = _row(proposed, executed, trial)
    title = f"{name}, {source}: {motion.outcome}"
    return scene_view(scene, objects, proposed, evaluation.hand, title, which, motion)


def _row(proposed: GraspCandidates, executed: GraspCandidates, trial: int) -> int:
    """The row of `proposed` that an executed grasp is."""
    away = np.abs(proposed.position - executed.position[trial]).sum(1)
    turned = np.abs(proposed.rotation - executed.rotation[trial]).sum((1, 2))
    return int(np.argmin(away + turned))
