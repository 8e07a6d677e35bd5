"""dmfc: train, ablate and evaluate dense multi-fingered grasp networks.

`dmfc.load()` gives a trained model as a function of a point cloud; `dmfc.Experiment` trains,
evaluates and runs sweeps in a store; `dmfc.evaluate()` executes the grasps of your own method.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from pathlib import Path

    from dmfc.experiment.api import Experiment as Experiment
    from dmfc.experiment.evaluation import Evaluation
    from dmfc.methods.observation import Observation
    from dmfc.prediction.planner import GraspPlanner

__version__ = "0.1.0"
__all__ = ["Experiment", "evaluate", "load"]


def load(model: str | Path | None = None) -> GraspPlanner:
    """A trained model as a function: `grasps = dmfc.load()(points)`.

    `model`: a shipped model's name, or the folder of a trained one; None: the default. What the
    function takes and answers: `dmfc.prediction.planner.GraspPlanner`.
    """
    from dmfc.prediction import planner

    return planner.load(model)


def evaluate(
    method: Callable[[Observation], Any] | str,
    scenes: str = "",
    protocol: str = "",
    preset: str = "quick",
    settings: Mapping[str, Any] | None = None,
    store: str | Path = "store",
) -> Evaluation:
    """Execute the grasps of a method on test scenes in MuJoCo: `dmfc.evaluate(predict)`.

    As `Experiment(preset, settings, store).evaluate(method, scenes, protocol)`.
    """
    from dmfc.experiment.api import Experiment

    return Experiment(preset, settings, store).evaluate(method, scenes, protocol)


def __getattr__(name: str) -> Any:
    """`Experiment`, imported when it is first used: `import dmfc` alone loads no library."""
    if name == "Experiment":
        from dmfc.experiment.api import Experiment

        return Experiment
    raise AttributeError(f"module 'dmfc' has no attribute '{name}'")
