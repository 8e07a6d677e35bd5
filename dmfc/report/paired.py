"""Two models on the same scenes: the difference of their overall rates, and what it is worth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
import pandas as pd

from dmfc.errors import DmfcError
from dmfc.report.clusters import CONFIDENCE, Spread, of_mean, p_value
from dmfc.report.rates import Over, grid, objects_of, scene_objects

TRIAL = ["seed", "scene", "trial"]


@dataclass(frozen=True)
class Comparison:
    """Model a against model b, over the scenes and seeds that both were executed in."""

    scenes: int
    trials: int
    """Of each model."""
    seeds: int
    overall_a: float
    overall_b: float
    difference: float
    """a - b."""
    standard_error: float
    low: float
    """95 % interval of the difference: for new scenes of the same objects, or for new objects;
    with several seeds for a new training of both, too."""
    high: float
    p: float
    """Two-sided, from the same spread."""
    only_a: int
    """Trials that only a held."""
    only_b: int
    p_holm: float
    """p, corrected by Holm (1979) for all comparisons that it was made with."""

    def row(self) -> dict[str, Any]:
        """All of it, by name."""
        return asdict(self)


def compare(
    a: pd.DataFrame, b: pd.DataFrame, over: Over = "scenes", confidence: float = CONFIDENCE
) -> Comparison:
    """Compare trial rows of two models. Raises DmfcError if they are of different trials."""
    table = _side_by_side(a, b)
    held_a, held_b = table["a"].to_numpy(float), table["b"].to_numpy(float)
    spread = _spread(table, "scene")
    if over == "objects":
        spread = max(spread, _spread(table, "object"), key=lambda one: float(one.half_width()))
    difference = float(held_a.mean() - held_b.mean())
    half, p = float(spread.half_width(confidence)), p_value(difference, spread)
    return Comparison(
        scenes=table["scene"].nunique(),
        trials=len(table),
        seeds=spread.seed_count,
        overall_a=float(held_a.mean()),
        overall_b=float(held_b.mean()),
        difference=difference,
        standard_error=float(np.sqrt(spread.variance)),
        low=max(-1.0, difference - half),
        high=min(1.0, difference + half),
        p=p,
        only_a=int((held_a > held_b).sum()),
        only_b=int((held_b > held_a).sum()),
        p_holm=p,
    )


def together(found: Sequence[Comparison]) -> list[Comparison]:
    """Comparisons that are read side by side, their `p_holm` corrected for the number of them."""
    order = sorted(range(len(found)), key=lambda place: found[place].p)
    corrected = [0.0] * len(found)
    largest = 0.0
    for rank, place in enumerate(order):
        largest = max(largest, min(1.0, (len(found) - rank) * found[place].p))
        corrected[place] = largest
    return [replace(one, p_holm=p) for one, p in zip(found, corrected, strict=True)]


def _side_by_side(a: pd.DataFrame, b: pd.DataFrame) -> pd.DataFrame:
    """Seed, scene, trial and object, and as a and b 1.0 where the model held."""
    held_a, held_b = _held(a), _held(b)
    if not held_a.index.equals(held_b.index) or held_a.empty:
        raise DmfcError(
            f"{len(held_a)} and {len(held_b)} trials that are not of the same scenes and numbers "
            "cannot be compared in pairs"
        )
    both = pd.DataFrame({"a": held_a, "b": held_b}).reset_index()
    known = scene_objects(pd.concat([a, b])) if "object" in a and "object" in b else {}
    # A scene of several objects is a cluster of its own: the two may have gone for different ones.
    return both.assign(object=objects_of(both.assign(object=""), known))


def _spread(table: pd.DataFrame, cluster: str) -> Spread:
    """Of the mean difference. Clusters of different size count by their trials."""
    difference = (table["a"] - table["b"]).to_numpy(float)
    total, size = grid(table, cluster, (difference, np.ones(len(table))))
    return of_mean(total, size)


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
