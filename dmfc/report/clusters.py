"""How far a rate or a difference is from the truth where trials come in clusters.

Trials of one scene (or of one object) share their fate, and so do the trials of one training. The
variance is that of the clusters' totals: for a ratio, of its linearised residuals (Cochran,
Sampling Techniques, 1977, chapter 6); with several seeds, all of which are executed on the same
clusters, the part that seeds add is the component of the two-way table of seeds x clusters. The
quantile of an interval weighs Student's t of clusters - 1 and of seeds - 1 degrees of freedom by
these parts (Cochran and Cox, Experimental Designs, 1957). Rates take the interval of
Wilson at the effective number of trials (Korn and Graubard 1998 do so with another interval).

Where all clusters agree, or nearly, their spread is not known. So it is estimated as if a little of
two more clusters had been seen: one in which all was held and one in which nothing was. With 0 of n
a cluster then counts as one trial.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import brentq
from scipy.stats import t as student

CONFIDENCE = 0.95
PRIOR = 0.05
"""Of a cluster that held all, and of one that held nothing, for the estimate of the spread."""
Array = np.ndarray[Any, Any]


@dataclass(frozen=True)
class Spread:
    """The variance of an estimate in its two parts; arrays over the leading axes of its data."""

    clusters: Array
    """Variance of the estimate if the seeds stay, clusters are drawn anew."""
    seeds: Array
    """What new seeds add to it; 0 with one seed: then nothing is known of another."""
    cluster_count: Array
    seed_count: int

    @property
    def variance(self) -> Array:
        """Of the estimate; infinite with fewer than two clusters."""
        return self.clusters + self.seeds

    def half_width(self, confidence: float = CONFIDENCE) -> Array:
        """Half the width of an interval that is symmetric around the estimate."""
        tail = (1 + confidence) / 2
        with np.errstate(invalid="ignore"):
            near = student.ppf(tail, np.maximum(self.cluster_count - 1, 1)) ** 2 * self.clusters
        far = student.ppf(tail, max(self.seed_count - 1, 1)) ** 2 * self.seeds
        return np.sqrt(near + far)

    def quantile(self, confidence: float = CONFIDENCE) -> Array:
        """How many standard errors an interval reaches to each side."""
        few = self.cluster_count < 2
        ratio = self.half_width(confidence) / np.sqrt(np.where(few, 1.0, self.variance))
        return np.where(few, math.inf, ratio)


def of_mean(totals: Array, sizes: Array) -> Spread:
    """The spread of the mean of values in [-1, 1], given their sums and numbers [..., S, C]."""
    scale = (sizes.shape[-2] * sizes.shape[-1] / sizes.sum((-2, -1)))[..., None, None]
    mean = totals.sum((-2, -1)) / sizes.sum((-2, -1))
    residuals = (totals - mean[..., None, None] * sizes) * scale
    count = np.full(mean.shape, totals.shape[-1])
    return _spread(residuals, count, PRIOR * ((1 - mean) ** 2 + (1 + mean) ** 2))


def effective_trials(successes: Array, trials: Array) -> tuple[Array, Array]:
    """How many independent trials a rate is worth, and the quantile of its interval.

    successes, trials: per seed and cluster [..., S, C], of which a cluster may be empty. Both
    results have the leading axes; nan where there are no trials at all.
    """
    filled = trials.sum(-2) > 0
    count = filled.sum(-1)
    total, held = trials.sum((-2, -1)).astype(float), successes.sum((-2, -1))
    with np.errstate(invalid="ignore", divide="ignore"):
        size = total / count
        rate = (held + PRIOR * size) / (total + 2 * PRIOR * size)
        # Of the mean over clusters of (held - rate x trials), in units of a cluster of that size.
        scale = (trials.shape[-2] / size)[..., None, None]
        residuals = (successes - rate[..., None, None] * trials) * scale
        spread = _spread(residuals, count, PRIOR * ((1 - rate) ** 2 + rate**2))
        shrunk = rate * (1 - rate) * count / (count + 2 * PRIOR)
        effective = np.minimum(shrunk / spread.variance, total)
    return np.where(count < 2, np.minimum(count, total), effective), spread.quantile()


def wilson(rate: Array, trials: Array, quantile: Array) -> tuple[Array, Array]:
    """Wilson's interval (1927), no continuity correction; [0, 1] where `quantile` is infinite."""
    with np.errstate(invalid="ignore"):
        square = quantile**2
        middle = (rate + square / (2 * trials)) / (1 + square / trials)
        spread = rate * (1 - rate) / trials + square / (4 * trials**2)
        half = quantile / (1 + square / trials) * np.sqrt(spread)
    low, high = np.clip(middle - half, 0, 1), np.clip(middle + half, 0, 1)
    endless = np.isinf(quantile)
    return np.where(endless, 0.0, low), np.where(endless, 1.0, high)


def p_value(estimate: float, spread: Spread) -> float:
    """Two-sided, of an estimate that is 0 in truth: 1 - the confidence that just leaves 0 out."""
    if not estimate or not np.isfinite(spread.variance):
        return 1.0

    def beyond(tail: float) -> float:
        return float(spread.half_width(1 - tail)) - abs(estimate)

    least = 1e-15
    return 0.0 if beyond(least) < 0 else float(brentq(beyond, least, 1.0))


def _spread(residuals: Array, count: Array, prior: Array) -> Spread:
    """Of the mean over `count` clusters of residuals [..., S, C] that are 0 in empty ones."""
    seeds = residuals.shape[-2]
    per_cluster = residuals.mean(-2)
    with np.errstate(invalid="ignore", divide="ignore"):
        places = count + 2 * PRIOR
        clusters = ((per_cluster**2).sum(-1) + prior) / places / (places - 1)
        clusters = np.where(count < 2, math.inf, clusters)
        if seeds == 1:
            return Spread(clusters, np.zeros(clusters.shape), count, 1)
        per_seed = residuals.sum(-1) / count[..., None]
        centre = per_seed.mean(-1)
        between = ((per_seed - centre[..., None]) ** 2).sum(-1) / (seeds - 1) / seeds
        # Empty clusters have residuals of 0: the sum of squares is that of the filled ones.
        rest = (residuals**2).sum((-2, -1)) - seeds * (per_cluster**2).sum(-1)
        rest = rest - count * (per_seed**2).sum(-1) + seeds * count * centre**2
        noise = rest / ((seeds - 1) * (count - 1)) / (seeds * count)
        added = np.maximum(between - noise, 0)
    return Spread(clusters, np.where(count < 2, 0.0, added), count, seeds)
