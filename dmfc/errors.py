"""The error that a user sees: one line that says what, why and which setting."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


class DmfcError(Exception):
    """A failure that is explained to the user on one line, without a traceback."""


class MachineError(DmfcError):
    """A failure of the machine (network, cache, disk, memory, missing program), not of the work.

    Another machine may do the same work, so nothing of it is recorded as a result.
    """


MACHINE_ERRORS = (MachineError, OSError, MemoryError, ImportError)


def of_machine(error: BaseException) -> bool:
    """Whether `error`, or what it was raised from, is a failure of the machine."""
    cause: BaseException | None = error
    while cause is not None:
        if isinstance(cause, MACHINE_ERRORS):
            return True
        cause = cause.__cause__
    return False


def unknown_name(what: str, name: str, choices: Iterable[str]) -> DmfcError:
    """The error for a name that is not among `choices`: names the nearest one, then all of them."""
    choices = sorted(choices)
    near = difflib.get_close_matches(name, choices, n=1, cutoff=0.4)
    hint = f"; did you mean '{near[0]}'?" if near else ""
    listed = ", ".join(choices[:20]) + (", ..." if len(choices) > 20 else "")
    return DmfcError(f"unknown {what} '{name}'{hint} (choices: {listed})")
