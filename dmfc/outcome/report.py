"""Quality of an outcome predictor, on trials of objects that it was not trained on."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from dmfc.outcome.calibration import Reliability, auc, auc_within, reliability

if TYPE_CHECKING:
    from dmfc.outcome.trials import Trials


@dataclass(frozen=True)
class Report:
    """Of n trials that were clear of the cloud; held by the product of both probabilities."""

    trials: int
    objects: int
    scenes: int
    held_rate: float
    planned_auc: float
    held_auc: float
    held_auc_within: float
    """Of pairs of the same scene."""
    calibration_error: float
    reliability: Reliability

    def to_dict(self) -> dict[str, Any]:
        """As JSON's types."""
        return asdict(self)


def report(planned: np.ndarray, held_if_planned: np.ndarray, trials: Trials) -> Report:
    """Of probabilities [n], [n] that were given to trials without having seen their objects."""
    planned, score = planned[trials.clear], (planned * held_if_planned)[trials.clear]
    trials = trials[trials.clear]
    found = reliability(score, trials.held)
    return Report(
        trials=len(trials),
        objects=len(np.unique(trials.object.astype(str))),
        scenes=len(np.unique(trials.scene)),
        held_rate=float(trials.held.mean()),
        planned_auc=auc(planned, trials.planned),
        held_auc=auc(score, trials.held),
        held_auc_within=auc_within(score, trials.held, trials.scene),
        calibration_error=found.error,
        reliability=found,
    )


def object_intervals(
    planned: np.ndarray, held_if_planned: np.ndarray, trials: Trials, draws: int = 400
) -> dict[str, tuple[float, float]]:
    """95 % intervals of `held_auc_within` and `calibration_error`, by bootstrap over objects."""
    clear = trials.clear
    score, held, scene = (planned * held_if_planned)[clear], trials.held[clear], trials.scene[clear]
    _, which = np.unique(trials.object[clear].astype(str), return_inverse=True)
    rows = [np.flatnonzero(which == k) for k in range(which.max() + 1)]
    generator = np.random.default_rng(0)
    found = []
    for _ in range(draws):
        drawn = generator.integers(len(rows), size=len(rows))
        some = np.concatenate([rows[k] for k in drawn])
        # An object that is drawn twice has scenes of its own each time.
        turn = np.repeat(np.arange(len(rows)), [len(rows[k]) for k in drawn])
        scenes = np.unique(np.stack([turn, scene[some]]), axis=1, return_inverse=True)[1].ravel()
        within = auc_within(score[some], held[some], scenes)
        found.append((within, reliability(score[some], held[some]).error))
    low, high = np.nanquantile(found, [0.025, 0.975], axis=0)
    names = "held_auc_within", "calibration_error"
    return {name: (float(low[k]), float(high[k])) for k, name in enumerate(names)}
