"""dmfc: train, ablate and evaluate dense multi-fingered grasp networks."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path

    from dmfc.prediction.planner import GraspPlanner

__version__ = "0.1.0"


def load(model: str | Path | None = None) -> GraspPlanner:
    """A trained model as a function: `grasps = dmfc.load()(points)`.

    `model`: a shipped model's name, or the folder of a trained one; None: the default. What the
    function takes and answers: `dmfc.prediction.planner.GraspPlanner`.
    """
    from dmfc.prediction import planner

    return planner.load(model)
