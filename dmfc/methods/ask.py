"""Asks a method for grasps; its time and its errors are part of the result."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from dmfc.errors import DmfcError, first_line, of_machine
from dmfc.methods.answer import Answer, checked, nothing
from dmfc.methods.observation import Observation

Predict = Callable[[Observation], Any]
"""A method: what it gives for a scene is described at `dmfc.methods.answer.checked`."""
NO_FILE = "no file of grasps"
"""Why a scene failed that a method in files has left out."""


@dataclass(frozen=True)
class Answered:
    """What a method gave for one scene."""

    answer: Answer
    seconds: float = float("nan")
    """Wall time of the call; NaN: not known."""
    failure: str = ""
    """Why there is no answer, on one line; empty if there is one."""
    used: str = ""
    """What it asked for besides the cloud, such as 'normals segments'."""

    @property
    def columns(self) -> dict[str, Any]:
        """Of each trial row of the scene."""
        return {
            "method_seconds": self.seconds,
            "method_failure": self.failure,
            "method_used": self.used,
        }


def ask(predict: Predict, seen: Observation) -> Answered:
    """Call a method. Whatever it raises, and an answer that is refused, is a failure of the scene.

    Raises DmfcError where the machine is at fault: a missing file or package, no memory.
    """
    start = time.perf_counter()
    failure, answer = "", nothing(len(seen.hand.dof_names))
    try:
        given = predict(seen)
        seconds = time.perf_counter() - start
        answer = checked(given, seen)
    except Exception as error:  # whatever somebody else's code raises
        seconds = time.perf_counter() - start
        failure = first_line(error)
        if not isinstance(error, DmfcError):
            failure = f"{type(error).__name__}: {failure}"
        if of_machine(error):
            raise DmfcError(f"the method cannot run here: {failure}") from error
    return Answered(answer, seconds, failure, " ".join(sorted(seen.used)))
