"""Units of length that files of others may have."""

from __future__ import annotations

from dmfc.errors import unknown_name

UNITS = {"m": 1.0, "cm": 0.01, "mm": 0.001, "inch": 0.0254}
"""Metres per unit."""


def metres(unit: str) -> float:
    """Metres per `unit`. Raises DmfcError where it is unknown."""
    if unit not in UNITS:
        raise unknown_name("unit", unit, UNITS)
    return UNITS[unit]
