"""Training one model: what `dmfc train` does."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dmfc.errors import unknown_name
from dmfc.experiment.session import Session, require

if TYPE_CHECKING:
    import pandas as pd

    from dmfc.engine.stage import Stage
    from dmfc.prediction.planner import GraspPlanner

PHASES = {"pretrain": "pretrained", "finetune": "finetuned"}
"""The two phases of the schedule, and the model that each one gives."""


@dataclass(frozen=True)
class TrainedModel:
    """A model that training left in the store."""

    address: str
    """Its stage, 'pretrain/KEY'."""
    folder: Path
    """Weights, settings and metrics."""

    @property
    def metrics(self) -> pd.DataFrame:
        """A row per epoch and split, with the losses."""
        import pandas as pd

        return pd.DataFrame(self.epochs)

    @property
    def epochs(self) -> list[dict[str, Any]]:
        """The rows of `metrics` as dictionaries."""
        from dmfc.pipeline.artifacts import load_metrics

        return load_metrics(self.folder)

    def planner(self) -> GraspPlanner:
        """The model as a function of a point cloud, as `dmfc.load` gives it."""
        from dmfc.prediction.planner import load

        return load(self.folder)


def training_stage(session: Session, phase: str) -> Stage:
    """The stage that trains the model of a phase. Raises DmfcError for another name."""
    if phase not in PHASES:
        raise unknown_name("stage", phase, PHASES)
    stage = session.builder.cell(session.config, PHASES[phase], "train").model
    assert stage is not None
    return stage


def train_model(session: Session, phase: str) -> TrainedModel:
    """Train, with all that it needs, unless the store has the model."""
    stage = training_stage(session, phase)
    require(session.make([stage]), [stage])
    return TrainedModel(stage.address, session.ledger.verified(stage.address))
