"""Two models on the same scenes: the difference of their overall rates, and what it is worth."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import pandas as pd
from scipy.stats import binomtest, bootstrap, permutation_test

from dmfc.errors import DmfcError
from dmfc.report.rates import CONFIDENCE

RESAMPLES = 9999
TRIAL = ["seed", "scene", "trial"]


@dataclass(frozen=True)
class Comparison:
    """Model a against model b, over the scenes that both were executed in."""

    scenes: int
    trials: int
    """Of each model."""
    overall_a: float
    overall_b: float
    difference: float
    """a - b."""
    low: float
    """95 % interval of the difference: bootstrap over scenes, whose trials belong together."""
    high: float
    p_scenes: float
    """Two-sided, by turning the sign of the difference of whole scenes."""
    only_a: int
    """Trials that only a held."""
    only_b: int
    p_mcnemar: float
    """Exact test of McNemar on those two counts; it takes trials as independent."""

    def row(self) -> dict[str, Any]:
        """All of it, by name."""
        return asdict(self)


def compare(a: pd.DataFrame, b: pd.DataFrame) -> Comparison:
    """Compare trial rows of two models. Raises DmfcError if they are of different trials."""
    held_a, held_b = _held(a), _held(b)
    if not held_a.index.equals(held_b.index) or held_a.empty:
        raise DmfcError(
            f"{len(held_a)} and {len(held_b)} trials that are not of the same scenes and numbers "
            "cannot be compared in pairs"
        )
    difference = (held_a - held_b).groupby(level=["seed", "scene"]).mean().to_numpy()
    only_a, only_b = int((held_a > held_b).sum()), int((held_b > held_a).sum())
    low, high = _interval(difference)
    return Comparison(
        scenes=len(difference),
        trials=len(held_a),
        overall_a=float(held_a.mean()),
        overall_b=float(held_b.mean()),
        difference=float(held_a.mean() - held_b.mean()),
        low=low,
        high=high,
        p_scenes=_sign_test(difference),
        only_a=only_a,
        only_b=only_b,
        p_mcnemar=float(binomtest(only_a, only_a + only_b).pvalue) if only_a + only_b else 1.0,
    )


def _held(rows: pd.DataFrame) -> pd.Series:
    """1.0 or 0.0 per trial, in the order of their numbers; rows of one seed need not say which."""
    table = rows if "seed" in rows else rows.assign(seed=0)
    missing = {*TRIAL, "held", "planned"} - set(table)
    if missing:
        raise DmfcError(f"these are not trial rows: no column {', '.join(sorted(missing))}")
    if table.duplicated(TRIAL).any():
        raise DmfcError("a trial is in the rows twice: choose one cell of the table")
    held = (table["held"].astype(bool) & table["planned"].astype(bool)).astype(float)
    return held.set_axis(pd.MultiIndex.from_frame(table[TRIAL])).sort_index()


def _interval(difference: np.ndarray) -> tuple[float, float]:
    if np.ptp(difference) == 0:  # nothing to draw from
        return float(difference[0]), float(difference[0])
    found = bootstrap(
        (difference,),
        np.mean,
        n_resamples=RESAMPLES,
        confidence_level=CONFIDENCE,
        method="percentile",
        random_state=np.random.default_rng(0),
    ).confidence_interval
    return float(found.low), float(found.high)


def _sign_test(difference: np.ndarray) -> float:
    if not difference.any():
        return 1.0
    found = permutation_test(
        (difference,),
        lambda values, axis: np.mean(values, axis=axis),
        permutation_type="samples",
        vectorized=True,
        n_resamples=RESAMPLES,
        random_state=np.random.default_rng(0),
    )
    return float(found.pvalue)
