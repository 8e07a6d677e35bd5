"""From trial rows to rates with their uncertainty. Pure functions; no file is touched here."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import pandas as pd
from scipy.stats import binomtest

from dmfc.errors import DmfcError

CONFIDENCE = 0.95
COLUMNS = ("scene", "trial", "object", "planned", "held")
"""Columns of a trial table that the rates are made from."""


@dataclass(frozen=True)
class Rate:
    """A share of successes. `value` is None where there were no trials."""

    successes: int
    trials: int

    @property
    def value(self) -> float | None:
        """Successes over trials."""
        return self.successes / self.trials if self.trials else None

    @property
    def standard_error(self) -> float | None:
        """sqrt(p (1 - p) / n)."""
        if self.value is None:
            return None
        return math.sqrt(self.value * (1 - self.value) / self.trials)

    @property
    def interval(self) -> tuple[float, float] | None:
        """The 95 % interval of Wilson (1927), without continuity correction."""
        if not self.trials:
            return None
        found = binomtest(self.successes, self.trials).proportion_ci(CONFIDENCE, method="wilson")
        return float(found.low), float(found.high)


@dataclass(frozen=True)
class Rates:
    """The three rates of the paper over the same trials."""

    valid: Rate
    """Planned / (K x scenes)."""
    success: Rate
    """Held / planned."""
    overall: Rate
    """Held / (K x scenes)."""


def rates(rows: pd.DataFrame, trials: int) -> Rates:
    """The rates of `rows` over `trials` = K x scenes; a row that is missing counts as a failure.

    Raises DmfcError if there are more rows than trials, a trial is there twice, or a column is
    missing: then the denominator would not be what it claims.
    """
    lacking = [name for name in COLUMNS if name not in rows.columns]
    if lacking:
        raise DmfcError(f"the trial rows have no columns {', '.join(lacking)}")
    if len(rows) > trials:
        raise DmfcError(f"{len(rows)} trial rows for {trials} trials (K x scenes)")
    identity = [name for name in ("seed", "scene", "trial") if name in rows.columns]
    if rows.duplicated(identity).any():
        raise DmfcError("a trial is in the rows twice")
    planned_mask = rows["planned"].astype(bool)
    planned = int(planned_mask.sum())
    held = int((rows["held"].astype(bool) & planned_mask).sum())
    return Rates(Rate(planned, trials), Rate(held, planned), Rate(held, trials))


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
