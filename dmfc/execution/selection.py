"""K of all proposed grasps: ranked, clear of what was seen, and spread."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from dmfc.config.execution import ExecutionConfig
from dmfc.execution.candidates import GraspCandidates
from dmfc.geometry.points import farthest_points

CHUNK = 32
"""Grasps that are checked against the cloud at a time, the best first, until there are enough."""
Levels = Callable[[GraspCandidates], np.ndarray]
"""Candidates -> [n] how clear of the cloud: 2 by a margin, 1 within tolerance, 0 not."""


@dataclass(frozen=True)
class Selection:
    """The at most K that are executed, and how many were left after each step."""

    chosen: GraspCandidates
    proposed: int
    confident: int
    """Of those, the ones that are confident enough; where an outcome predictor ranks: all."""
    checked: int
    """Of those, the ones that were held against the cloud before there were enough."""
    clear: int
    """Of those, the ones that are clear of it; without a check: as many as are confident."""


def select(
    candidates: GraspCandidates, config: ExecutionConfig, levels: Levels | None = None
) -> Selection:
    """Those of enough confidence and clear of the cloud, the best, spread by farthest points.

    Farthest points are outliers: `most_confident` bounds how far down they may be looked for. The
    first is the best. Ties keep their order. What is clear without the margin alone is taken where
    there are fewer than K others, in the order of the score. Without `levels` nothing is checked.
    """
    rows = np.argsort(-candidates.score, kind="stable")
    if config.score == "confidence":
        rows = rows[candidates.confidence[rows] >= config.min_confidence]
    confident, checked = len(rows), 0
    rows = rows[~np.isnan(candidates.score[rows])]
    close = rows[:0]
    if levels is not None:
        rows, close, checked = _clear(candidates, rows, config.most_confident, levels)
    clear = len(rows) + len(close)
    rows = rows[: config.most_confident or None]
    if len(rows) > config.grasps_per_scene:
        spread = farthest_points(candidates.position[rows], config.grasps_per_scene)
        rows = rows[spread]
    rows = np.concatenate([rows, close[: max(config.grasps_per_scene - len(rows), 0)]])
    return Selection(candidates[rows], len(candidates), confident, checked, clear)


def _clear(
    candidates: GraspCandidates, rows: np.ndarray, wanted: int, levels: Levels
) -> tuple[np.ndarray, np.ndarray, int]:
    """Rows that are clear by the margin, until `wanted` are found (0: all); those clear without it;
    how many were checked."""
    clear: list[np.ndarray] = [rows[:0]]
    close: list[np.ndarray] = [rows[:0]]
    checked = 0
    for first in range(0, len(rows), CHUNK):
        if wanted and sum(map(len, clear)) >= wanted:
            break
        some = rows[first : first + CHUNK]
        level = levels(candidates[some])
        clear.append(some[level == 2])
        close.append(some[level == 1])
        checked += len(some)
    return np.concatenate(clear), np.concatenate(close), checked
