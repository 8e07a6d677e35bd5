"""How good an outcome predictor is, asked about executed predictions that it did not learn from."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from dmfc.engine.stage import Stage
    from dmfc.experiment.session import Session
    from dmfc.outcome.trials import Trials

LARGE = 0.15
"""Metres: an object with a longer side is a large one."""


def judged_on(session: Session, outcome: Stage, predictor: Path) -> list[dict[str, Any]]:
    """A row per group of trials: all, alone, in clutter, of large objects, of others.

    Executes the rollouts of the stage `outcome` where they are missing, and asks the predictor in
    a folder about them. Intervals are of a bootstrap over objects.
    """
    import numpy as np

    from dmfc.execution.rollouts import ROLLOUTS
    from dmfc.outcome.files import refuse_learned
    from dmfc.outcome.judge import Judge
    from dmfc.outcome.trials import Trials, read_trials
    from dmfc.pipeline.artifacts import SCENES
    from dmfc.pipeline.stages import present

    judge = Judge.load(predictor)
    stages = outcome.inputs["rollouts"]
    assert isinstance(stages, tuple)
    refuse_learned(predictor, [obj.name for obj in _objects(stages)], "outcome.objects")
    session.make(stages)
    found: dict[str, Trials] = {}
    for name in ("alone", "clutter"):
        chosen = [s for s in stages if s.name.startswith("clutter:") == (name == "clutter")]
        if chosen:
            folders = present([session.ledger.folder(stage.address) for stage in chosen])
            files = [(folder / ROLLOUTS, folder / SCENES) for folder in folders]
            read = read_trials(files, judge.features)
            first = sum(len(t) for t in found.values())  # more than there are scenes
            found[name] = dataclasses.replace(read, scene=read.scene + first)
    trials = Trials.of(list(found.values()))
    longest = _longest_sides(session, stages)
    large = np.array([longest[str(name)] > LARGE for name in trials.object])
    clutter = np.repeat([name == "clutter" for name in found], [len(t) for t in found.values()])
    groups = {
        "all": np.ones(len(trials), dtype=bool),
        "alone": ~clutter,
        "clutter": clutter,
        f"longest side > {LARGE:g} m": large,
        f"longest side <= {LARGE:g} m": ~large,
    }
    return [_row(name, judge, trials[rows]) for name, rows in groups.items() if rows.any()]


def _longest_sides(session: Session, stages: tuple[Stage, ...]) -> dict[str, float]:
    from dmfc.pipeline.artifacts import load_object

    longest = {}
    for obj in _objects(stages):
        vertices = load_object(session.ledger.folder(obj.address)).vertices
        longest[obj.name] = float((vertices.max(0) - vertices.min(0)).max())
    return longest


def _objects(stages: tuple[Stage, ...]) -> list[Stage]:
    """The objects of stages of rollouts, each once."""
    found: dict[str, Stage] = {}
    for stage in stages:
        objects = stage.inputs["objects"]
        found |= {obj.name: obj for obj in (objects if isinstance(objects, tuple) else (objects,))}
    return list(found.values())


def _row(group: str, judge: Any, trials: Trials) -> dict[str, Any]:
    from dmfc.outcome.report import object_intervals, report

    verdict = judge.of_features(trials.features)
    said = report(verdict.planned, verdict.held_if_planned, trials).to_dict()
    row = {"group": group, **said}
    for name, (low, high) in object_intervals(
        verdict.planned, verdict.held_if_planned, trials
    ).items():
        row |= {f"{name}_low": low, f"{name}_high": high}
    return row
