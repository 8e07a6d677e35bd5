"""Which measure of a predicted grasp tells that execution will refuse it.

python -m analysis.refused STORE PRESET [KEY=VALUE ...]

For the most confident predictions of the pre-trained network in every test scene: whether the
motion is planned (no physics is stepped), against the terms of the loss at the predicted hand, and
collision of the same hand opened, as it approaches. Prints the share that is planned, Spearman's
correlation of each measure with it over all predictions and in the mean of the scenes where both
happen, and the share that is planned of the KEPT of each scene that are best by the measure.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pandas as pd
import torch
from scipy.stats import spearmanr

from dmfc.errors import DmfcError
from dmfc.execution.candidates import GraspCandidates
from dmfc.execution.evaluate import Evaluation
from dmfc.experiment.evaluation import evaluated
from dmfc.losses.task import SceneTerms
from dmfc.objects.atlas import ObjectAtlas, SceneObjects
from dmfc.pipeline.replay import input_folders
from dmfc.pipeline.stages import evaluation_of
from dmfc.scenes.scene_set import Scene

CONFIDENT, KEPT = 64, 16
MEASURES = ("collision", "collision, opened", "guidance", "q1_upper", "confidence")


@torch.no_grad()
def measures(
    terms: SceneTerms, found: Evaluation, scene: Scene, grasps: GraspCandidates
) -> dict[str, np.ndarray]:
    """Each of MEASURES, [n]; the confidence negative, so that less is better for all."""
    atlas = ObjectAtlas.of([found.objects[name] for name in dict.fromkeys(scene.object_ids)])
    index = torch.tensor([[atlas.ids.index(name) for name in scene.object_ids]])
    poses = torch.tensor(scene.T_world_object, dtype=torch.float32)[None]
    around = SceneObjects(atlas, index, poses).take(torch.zeros(len(grasps), dtype=torch.long))

    def of(joints: np.ndarray, *names: str) -> dict[str, np.ndarray]:
        values = grasps.position, grasps.rotation, joints
        position, rotation, angles = (torch.tensor(v, dtype=torch.float32) for v in values)
        result = terms(position, rotation, angles, around, names)
        return {name: value.numpy() for name, value in result.items()}

    opened = of(found.hand.opened(grasps.joints), "collision")["collision"]
    closed = of(grasps.joints, "collision", "guidance", "q1_upper")
    return {**closed, "collision, opened": opened, "confidence": -grasps.confidence}


def rows(store: Path, preset: str, overrides: list[str]) -> Iterator[pd.DataFrame]:
    """A frame per test scene, a row per prediction."""
    session, stages = evaluated("pretrained", preset, overrides, store)
    for stage in stages:
        folders = input_folders(session.ledger, stage.inputs)
        found = evaluation_of(stage.config, folders, stage.hints)
        terms = SceneTerms(found.hand, session.config.losses)
        for scene in found.scenes:
            grasps = found.proposals(scene)
            enough = np.flatnonzero(grasps.confidence >= found.config.min_confidence)
            order = np.argsort(-grasps.confidence[enough], kind="stable")
            grasps = grasps[enough[order[:CONFIDENT]]]
            if not len(grasps):
                continue
            runner = found.open(scene)
            planned = [
                runner.plan(grasps.T[row], grasps.joints[row], int(target))[1].planned
                for row, target in enumerate(grasps.object_index)
            ]
            frame = pd.DataFrame(measures(terms, found, scene, grasps))
            yield frame.assign(scene=scene.scene, planned=planned)


def report(found: pd.DataFrame) -> Iterator[str]:
    """The lines of a Markdown table."""
    scenes = [group for _, group in found.groupby("scene") if group.planned.nunique() == 2]
    share = found.planned.mean()
    yield f"{len(found)} predictions in {found.scene.nunique()} scenes, {share:.2f} planned\n"
    yield f"| measure | correlation | within a scene | planned of the best {KEPT} |"
    yield "|---|---|---|---|"
    for name in MEASURES:
        overall = spearmanr(found[name], found.planned).statistic
        inside = [spearmanr(g[name], g.planned).statistic for g in scenes if g[name].nunique() > 1]
        best = found.sort_values(name, kind="stable").groupby("scene").head(KEPT)
        told = f"{np.mean(inside):+.2f} | {best.planned.mean():.2f}"
        yield f"| {name} | {overall:+.2f} | {told} |"


if __name__ == "__main__":
    if len(sys.argv) < 3:
        raise SystemExit(__doc__)
    try:
        frames = pd.concat(rows(Path(sys.argv[1]), sys.argv[2], sys.argv[3:]))
    except DmfcError as error:
        raise SystemExit(str(error)) from error
    print("\n".join(report(frames)))
