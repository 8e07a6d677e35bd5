"""The error that a user sees: one line that says what, why and which setting."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable

_USER = re.compile(r"([A-Za-z][A-Za-z0-9+.-]*://)(?:[^\s/?#@:]*:\S*|[^\s/?#@]+)@")
_WORD = r"(?:pass(?:word|wd)?|pwd|(?:[a-z_]*[_-])?(?:token|secret|key))"
_PARAMETER = re.compile(rf"([?&;]{_WORD}=)[^&;#\s'\"]+", re.IGNORECASE)


def masked(text: str) -> str:
    """`text` with the user, password or token in each URI of it replaced by `***`."""
    return _PARAMETER.sub(r"\1***", _USER.sub(r"\1***@", text))


class DmfcError(Exception):
    """A failure that is explained to the user on one line, without a traceback.

    Passwords in URIs are masked.
    """

    def __init__(self, text: str) -> None:
        super().__init__(masked(text))


def unknown_name(what: str, name: str, choices: Iterable[str]) -> DmfcError:
    """The error for a name that is not among `choices`: names the nearest one, then all of them."""
    choices = sorted(choices)
    near = difflib.get_close_matches(name, choices, n=1, cutoff=0.4)
    hint = f"; did you mean '{near[0]}'?" if near else ""
    listed = ", ".join(choices[:20]) + (", ..." if len(choices) > 20 else "")
    return DmfcError(f"unknown {what} '{name}'{hint} (choices: {listed})")
