"""Range, length and kind of a setting, as its field states them."""

from __future__ import annotations

import dataclasses
import math
import typing
from collections.abc import Iterator
from functools import cache
from typing import Any

from dmfc.config.schema import Config

HUGE = 1e300
"""Whole numbers beyond this, which have no floating-point counterpart, count as infinite."""


@cache
def all_fields() -> dict[str, dataclasses.Field]:
    """The dataclass field of every dotted key of the settings, groups included."""
    return {key: field for key, field, _ in _walk(Config, "")}


@cache
def all_types() -> dict[str, Any]:
    """The type of every dotted key of the settings: a dataclass for a group."""
    return {key: kind for key, _, kind in _walk(Config, "")}


@cache
def former_keys() -> dict[str, str]:
    """The key of each renamed setting, by its former key."""
    return {
        f"{key.rpartition('.')[0]}.{field.metadata['formerly']}": key
        for key, field in all_fields().items()
        if field.metadata.get("formerly")
    }


def _walk(cls: type, prefix: str) -> Iterator[tuple[str, dataclasses.Field, Any]]:
    hints = typing.get_type_hints(cls)
    for field in dataclasses.fields(cls):
        kind = hints[field.name]
        yield prefix + field.name, field, kind
        if dataclasses.is_dataclass(kind):
            yield from _walk(typing.cast(type, kind), f"{prefix}{field.name}.")


def fault(key: str, raw: Any, value: Any) -> str | None:
    """What is wrong with a setting, as 'must be ...'; None if nothing is.

    raw: as it was given; value: after its conversion to the type of the setting.
    """
    if all_types()[key] is bool and not isinstance(raw, bool):
        return f"must be true or false, not {raw!r}"
    limits = all_fields()[key].metadata
    length = limits["length"]
    if length is not None and len(value) != length:
        return f"must have {length} entries, not {len(value)}"
    for number in _numbers(value):
        if not math.isfinite(number):
            return f"must be a finite number, not {number}"
        least, greatest = limits["least"], limits["greatest"]
        if least is not None and not least <= number <= greatest:
            return f"must be {range_text(key)}, not {number:g}"
    return None


def range_text(key: str) -> str:
    """'from 0 to 10 s', or the choices, of a setting; empty if it may be anything of its type."""
    limits, kind = all_fields()[key].metadata, all_types()[key]
    if typing.get_origin(kind) is typing.Literal:
        return "one of " + ", ".join(map(str, typing.get_args(kind)))
    if limits["least"] is None:
        return ""
    unit = f" {limits['unit']}" if limits["unit"] else ""
    return f"from {limits['least']:.10g} to {limits['greatest']:.10g}{unit}"


def _numbers(value: Any) -> Iterator[float]:
    """All numbers of a value, of lists and mappings at any depth too."""
    if isinstance(value, dict):
        value = list(value.values())
    if isinstance(value, list):
        for item in value:
            yield from _numbers(item)
    elif isinstance(value, int | float) and not isinstance(value, bool):
        too_large = isinstance(value, int) and abs(value) > HUGE
        yield math.copysign(math.inf, value > 0 or -1) if too_large else float(value)
