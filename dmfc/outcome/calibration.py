"""Whether probabilities are calibrated, and how well they rank the grasps of a scene."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize
from scipy.stats import rankdata

BINS = 10


def platt(logit: np.ndarray, happened: np.ndarray, weight: np.ndarray) -> tuple[float, float]:
    """Slope and shift [of n logits] with the least cross-entropy of sigmoid(slope l + shift).

    The slope is not negative: an order is not turned round.
    """
    sign = np.where(happened, 1.0, -1.0)

    def loss(x: np.ndarray) -> tuple[float, np.ndarray]:
        margin = sign * (x[0] * logit + x[1])
        wrong = weight / (1 + np.exp(np.clip(margin, -60, 60)))
        slope = -(wrong * sign * logit).sum(), -(wrong * sign).sum()
        return float((weight * np.logaddexp(0, -margin)).sum()), np.array(slope)

    found = minimize(loss, np.array([1.0, 0.0]), jac=True, bounds=[(0.0, None), (None, None)])
    return float(found.x[0]), float(found.x[1])


@dataclass(frozen=True)
class Reliability:
    """Probabilities in bins of equal width: how often it happened of what was said."""

    said: list[float]
    """Mean probability of each bin."""
    happened: list[float]
    """Share in which it happened."""
    trials: list[int]

    @property
    def error(self) -> float:
        """Expected calibration error: mean difference of the two, by trials."""
        gaps = np.abs(np.subtract(self.said, self.happened))
        return float(np.average(gaps, weights=self.trials)) if sum(self.trials) else 0.0


def reliability(said: np.ndarray, happened: np.ndarray) -> Reliability:
    """Of probabilities [n] and what became of them [n]; empty bins are left out."""
    which = np.minimum((said * BINS).astype(int), BINS - 1)
    bins = [which == k for k in range(BINS) if (which == k).any()]
    return Reliability(
        [float(said[rows].mean()) for rows in bins],
        [float(happened[rows].mean()) for rows in bins],
        [int(rows.sum()) for rows in bins],
    )


def auc(score: np.ndarray, happened: np.ndarray) -> float:
    """Probability that what happened has the higher score, ties half; NaN where it is always so."""
    good = int(happened.sum())
    bad = len(happened) - good
    if not good or not bad:
        return float("nan")
    ranks = rankdata(score)[happened.astype(bool)].sum()
    return float((ranks - good * (good + 1) / 2) / (good * bad))


def auc_within(score: np.ndarray, happened: np.ndarray, scene: np.ndarray) -> float:
    """The same of pairs of the same scene [n], all pairs alike; NaN without such a pair."""
    won = pairs = 0.0
    for number in np.unique(scene):
        rows = scene == number
        good = int(happened[rows].sum())
        count = good * (int(rows.sum()) - good)
        if count:
            won += count * auc(score[rows], happened[rows])
            pairs += count
    return won / pairs if pairs else float("nan")
