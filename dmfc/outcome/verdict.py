"""`Verdict`: predicted outcomes of grasps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Verdict:
    """What is expected of n grasps, as probabilities."""

    planned: np.ndarray
    """[n] the hand gets to the grasp without running into anything."""
    held_if_planned: np.ndarray
    """[n]."""

    @property
    def held(self) -> np.ndarray:
        """[n] the object is in the hand at the end."""
        return self.planned * self.held_if_planned
