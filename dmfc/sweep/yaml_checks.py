"""Checks of a sweep file; each error names the place and the expected form."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from dmfc.config.load import nearest_key
from dmfc.errors import DmfcError

LONGEST = 200
"""Most letters of a label or a title."""
SHOWN = 80
"""Letters of a wrong value that an error shows."""


def mapping(value: Any, where: str) -> Mapping[str, Any]:
    """`value`, if it is a mapping."""
    if not isinstance(value, Mapping):
        raise DmfcError(f"{where}: wants 'key: value' pairs, not {shortened(value)}")
    return value


def only_keys(values: Mapping[str, Any], allowed: Sequence[str], where: str) -> None:
    """Raises DmfcError on the first key that is not allowed, naming the nearest one."""
    for name in values:
        if name not in allowed:
            near = nearest_key(str(name), allowed)
            hint = f"; did you mean '{near}'?" if near else f" (known: {', '.join(allowed)})"
            raise DmfcError(f"{where}: unknown key '{name}'{hint}")


def text(value: Any, where: str) -> str:
    """`value` as one line of text, if it is a text or a number."""
    line = str(value)
    if not isinstance(value, str | int | float) or not line.isprintable() or len(line) > LONGEST:
        raise DmfcError(
            f"{where}: wants one line of up to {LONGEST} letters, not {shortened(value)}"
        )
    return line


def shortened(value: Any) -> str:
    """`value` as an error shows it, on one line."""
    shown = value if isinstance(value, str) and value.isprintable() else repr(value)
    return shown if len(shown) <= SHOWN else f"{shown[:SHOWN]}..."
