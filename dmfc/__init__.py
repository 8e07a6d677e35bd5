"""dmfc: train, ablate and evaluate dense multi-fingered grasp networks.

`dmfc.load()` gives a trained model as a function of a point cloud; `dmfc.Experiment` trains,
evaluates and runs sweeps in a store.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pathlib import Path

    from dmfc.experiment.api import Experiment as Experiment
    from dmfc.prediction.planner import GraspPlanner

__version__ = "0.1.0"
__all__ = ["Experiment", "load"]


def load(model: str | Path | None = None) -> GraspPlanner:
    """A trained model as a function: `grasps = dmfc.load()(points)`.

    `model`: a shipped model's name, or the folder of a trained one; None: the default. What the
    function takes and answers: `dmfc.prediction.planner.GraspPlanner`.
    """
    from dmfc.prediction import planner

    return planner.load(model)


def __getattr__(name: str) -> Any:
    """`Experiment`, imported when it is first used: `import dmfc` alone loads no library."""
    if name == "Experiment":
        from dmfc.experiment.api import Experiment

        return Experiment
    raise AttributeError(f"module 'dmfc' has no attribute '{name}'")
