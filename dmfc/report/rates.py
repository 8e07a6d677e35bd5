"""From trial rows to rates with their uncertainty. Pure functions; no file is touched here."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import pandas as pd
from scipy.special import ndtri

from dmfc.errors import DmfcError
from dmfc.report.clusters import CONFIDENCE, effective_trials, wilson

COLUMNS = ("scene", "trial", "object", "planned", "held")
"""Columns of a trial table that the rates are made from."""
NORMAL = float(ndtri((1 + CONFIDENCE) / 2))
Over = Literal["scenes", "objects"]
"""What an interval holds for: new scenes of the same objects, or new objects."""


@dataclass(frozen=True)
class Rate:
    """A share of successes. `value` is None where there were no trials."""

    successes: int
    trials: int
    effective: float = math.nan
    """Independent trials that these are worth; nan: as many as they are."""
    quantile: float = NORMAL
    """How many standard errors the interval reaches: more, the fewer the clusters."""

    @property
    def value(self) -> float | None:
        """Successes over trials."""
        return self.successes / self.trials if self.trials else None

    @property
    def worth(self) -> float:
        """Independent trials that these are worth."""
        return self.trials if math.isnan(self.effective) else self.effective

    @property
    def standard_error(self) -> float | None:
        """sqrt(p (1 - p) / n) at the effective n."""
        if self.value is None:
            return None
        return math.sqrt(self.value * (1 - self.value) / self.worth)

    @property
    def interval(self) -> tuple[float, float] | None:
        """The 95 % interval of Wilson at the effective number of trials."""
        if self.value is None:
            return None
        worth, quantile = np.asarray(self.worth), np.asarray(self.quantile)
        low, high = wilson(np.asarray(self.value), worth, quantile)
        return float(low), float(high)


@dataclass(frozen=True)
class Rates:
    """The three rates of the paper over the same trials."""

    valid: Rate
    """Planned / (K x scenes)."""
    success: Rate
    """Held / planned."""
    overall: Rate
    """Held / (K x scenes)."""


def rates(
    rows: pd.DataFrame,
    trials: int,
    over: Over = "scenes",
    scene_objects: Mapping[int, str] | None = None,
) -> Rates:
    """The rates of `rows` over `trials` = K x scenes x seeds; a missing row counts as a failure.

    Intervals are for new scenes of the same objects, or `over` new objects: `scene_objects` says
    which object a scene has, for trials that were aimed at none. With rows of several seeds they
    are for a new training, too.

    Raises DmfcError if there are more rows than trials, a trial is there twice, or a column is
    missing: then the denominator would not be what it claims.
    """
    _check(rows, trials)
    planned = rows["planned"].to_numpy(bool)
    held = rows["held"].to_numpy(bool) & planned
    every = np.ones(len(rows), bool)
    pairs = ((planned, every), (held, planned), (held, every))
    missing = trials - len(rows)
    found = [_rate(rows, "scene", pair, missing if pair[1] is every else 0) for pair in pairs]
    if over == "objects":
        clustered = rows.assign(_object=objects_of(rows, scene_objects or {}))
        wider = [
            _rate(clustered, "_object", pair, missing if pair[1] is every else 0) for pair in pairs
        ]
        # Objects can look alike by chance; scenes of them differ all the same.
        found = [max(pair, key=_width) for pair in zip(found, wider, strict=True)]
    return Rates(*found)


def objects_of(rows: pd.DataFrame, scene_objects: Mapping[int, str]) -> pd.Series:
    """The object of each trial; of one that was aimed at none, its scene's, or the scene itself."""
    named = rows["object"].astype("string").fillna("")
    scenes = rows["scene"].map(lambda scene: scene_objects.get(scene, f"scene {scene}"))
    return named.where(named != "", scenes.astype("string"))


def scene_objects(rows: pd.DataFrame) -> dict[int, str]:
    """The object of each scene that all its trials were aimed at, by the number of the scene."""
    aimed = rows[rows["object"].astype("string").fillna("") != ""]
    sets = aimed.groupby("scene")["object"].unique()
    return {int(scene): str(names[0]) for scene, names in sets.items() if len(names) == 1}


def grid(rows: pd.DataFrame, cluster: str, values: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Sums of each of `values` (a number per row) by seed and cluster [S, C]."""
    seeds = rows["seed"] if "seed" in rows.columns else pd.Series(0, index=rows.index)
    line, seed_names = pd.factorize(seeds, sort=True)
    column, names = pd.factorize(rows[cluster], sort=True)
    sums = []
    for value in values:
        summed = np.zeros((max(1, len(seed_names)), len(names)))
        np.add.at(summed, (line, column), value)
        sums.append(summed)
    return sums


def _rate(rows: pd.DataFrame, cluster: str, pair: tuple[Any, Any], missing: int) -> Rate:
    """Successes among trials, both as marks of the rows; rows that are missing have failed."""
    successes, trials = int(pair[0].sum()), int(pair[1].sum()) + missing
    if not trials or not len(rows):
        return Rate(successes, trials)
    held, tried = grid(rows, cluster, pair)
    if missing:  # in scenes of their own, as large as those that are there
        size = int(rows["trial"].max()) + 1
        padding = -(-missing // (size * len(tried)))
        held = np.pad(held, ((0, 0), (0, padding)))
        share = missing / (padding * len(tried))
        tried = np.pad(tried, ((0, 0), (0, padding)), constant_values=share)
    effective, quantile = effective_trials(held, tried)
    return Rate(successes, trials, float(effective), float(quantile))


def _width(rate: Rate) -> float:
    low, high = rate.interval or (0.0, 0.0)
    return high - low


def _check(rows: pd.DataFrame, trials: int) -> None:
    lacking = [name for name in COLUMNS if name not in rows.columns]
    if lacking:
        raise DmfcError(f"the trial rows have no columns {', '.join(lacking)}")
    if len(rows) > trials:
        raise DmfcError(f"{len(rows)} trial rows for {trials} trials (K x scenes)")
    identity = [name for name in ("seed", "scene", "trial") if name in rows.columns]
    if rows.duplicated(identity).any():
        raise DmfcError("a trial is in the rows twice")


def per_object(rows: pd.DataFrame) -> dict[str, Rates]:
    """The rates of the trials aimed at each object; trials without a grasp have no object."""
    aimed = rows[rows["object"].astype("string").fillna("") != ""]
    return {
        str(name): rates(group, len(group)) for name, group in aimed.groupby("object", sort=True)
    }


def reasons(rows: pd.DataFrame, trials: int) -> dict[str, int]:
    """How often each reason ended a trial, most frequent first; missing rows are 'missing'."""
    held = rows["held"].astype(bool)
    given = rows.loc[~held, "reason"].astype("string").fillna("") if "reason" in rows else []
    counts: dict[str, int] = {}
    for reason in given:
        counts[reason or "no reason given"] = counts.get(reason or "no reason given", 0) + 1
    if trials > len(rows):
        counts["missing"] = trials - len(rows)
    return dict(sorted(counts.items(), key=lambda item: (-item[1], item[0])))


def concatenate(parts: Sequence[pd.DataFrame]) -> pd.DataFrame:
    """The rows of several shards; an empty table with the right columns if there are none."""
    if not parts:
        return pd.DataFrame({name: pd.Series(dtype="object") for name in COLUMNS})
    return pd.concat(parts, ignore_index=True)
