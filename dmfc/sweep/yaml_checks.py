"""Checks of what a sweep file says; each error names the place and what was wanted."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from dmfc.config.load import nearest_key
from dmfc.errors import DmfcError


def mapping(value: Any, where: str) -> Mapping[str, Any]:
    """`value`, if it is a mapping."""
    if not isinstance(value, Mapping):
        raise DmfcError(f"{where}: wants 'key: value' pairs, not {value!r}")
    return value


def only_keys(values: Mapping[str, Any], allowed: Sequence[str], where: str) -> None:
    """Raises DmfcError on the first key that is not allowed, naming the nearest one."""
    for name in values:
        if name not in allowed:
            near = nearest_key(str(name), allowed)
            hint = f"; did you mean '{near}'?" if near else f" (known: {', '.join(allowed)})"
            raise DmfcError(f"{where}: unknown key '{name}'{hint}")
