"""Twenty steps of each stage from a fixed seed on four toy scenes; writes `golden_run.json`.

Fine-tuning comes in three forms: the paper's terms, the swept collision in their place, and
projected targets of it.

Run `python -m tests.training.golden_run` where a change of the losses is meant, and say so.
"""

from __future__ import annotations

import dataclasses
import json
import tempfile
from pathlib import Path

from dmfc.config.losses import (
    GraspSpace,
    LengthUnits,
    LossConfig,
    LossWeights,
    Q1Config,
    SweptConfig,
)
from dmfc.config.training import ProjectionConfig, StageSchedule, TrainingConfig
from dmfc.training.fit import fit
from dmfc.training.settings import FitConfig
from dmfc.training.task import Stage
from tests.support.toy import NETWORK, ToyData, toy_atlas, toy_hand

FILE = Path(__file__).with_suffix(".json")
STEPS = 20
TERMS = ("loss", "chamfer", "collision", "guidance", "q1_upper", "q1_lower", "swept", "projected")
# Spelled out, so that a new default is no change of the numbers.
LOSSES = LossConfig(
    grasp_space=GraspSpace(length_unit=1.0, joint_weight=1.0),
    units=LengthUnits(collision=1e-3, guidance=0.1),
    weights=LossWeights(1.0, 1.0, 1.0, 1.0, 1.0, q1_lower=1.0),
    q1=Q1Config(directions=728, torque_weight=10.0, floor=False),
)
TRAINING = TrainingConfig(
    # Small rates, or what a processor rounds differently grows: others become the hardest.
    pretrain=StageSchedule(epochs=STEPS, learning_rate=1e-4, decay=0.9, decay_every=10),
    finetune=StageSchedule(epochs=STEPS, learning_rate=1e-5, decay=0.9, decay_every=10),
    negatives="ignore",
    hard_stages="both",
    hard_scope="batch",
    finetune_seeds="all",
    max_gradient_norm=0,
    hard_samples=48,
    hard_error="task",
    rank_points=20,
    accelerator="cpu",
)
# Millimetres, not metres: the toy hand is deep in the table.
SWEPT = dataclasses.replace(
    LOSSES,
    weights=LossWeights(1.0, 0.0, 1.0, 0.0, 1.0, swept=1.0),
    units=LengthUnits(collision=1e-3, guidance=0.1, swept=1e-3),
    swept=SweptConfig(margin=0.005, grasp_tolerance=0.015),
    saturated=True,
)
PROJECTED = dataclasses.replace(
    TRAINING,
    finetune_form="projected",
    projection=ProjectionConfig(
        weight=4.0, steps=4, position=0.01, angle=0.17, joints=0.2, worse=0.1
    ),
)


def golden_run(
    stage: Stage,
    folder: Path,
    before: Path | None,
    losses: LossConfig = LOSSES,
    training: TrainingConfig = TRAINING,
) -> list[dict[str, float]]:
    """The terms of each step of a stage, from the weights in `before`; fills `folder`.

    An epoch is one batch of four scenes.
    """
    config = FitConfig(NETWORK, losses, training)
    work = folder.with_suffix(".work")
    fit(stage, config, toy_hand(), ToyData(count=4), toy_atlas(), folder, work, before)
    rows = [json.loads(line) for line in (folder / "metrics.jsonl").read_text().splitlines()]
    return [{name: row[name] for name in TERMS if name in row} for row in rows]


def with_weight(name: str, factor: float) -> LossConfig:
    """The settings of the run with one weight multiplied."""
    changed = {name: factor * getattr(LOSSES.weights, name)}
    return dataclasses.replace(LOSSES, weights=dataclasses.replace(LOSSES.weights, **changed))


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as temporary:
        first, second = Path(temporary) / "pretrain", Path(temporary) / "finetune"
        steps = {"pretrain": golden_run("pretrain", first, None)}
        steps["finetune"] = golden_run("finetune", second, first)
        for name, training in (("swept", TRAINING), ("projected", PROJECTED)):
            steps[name] = golden_run("finetune", Path(temporary) / name, first, SWEPT, training)
        FILE.write_text(json.dumps(steps, indent=1) + "\n")
