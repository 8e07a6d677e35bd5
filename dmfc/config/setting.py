"""`setting`: a dataclass field that carries its own meaning, unit and range."""

from __future__ import annotations

import copy
import dataclasses
from typing import Any

KEYS_VERSION = 2
"""Version of the settings' part of stage keys. A higher version reruns every stage.

Raise it to change a default, and then drop the marks `later` and `formerly` of settings that came
before. 1 had the settings of the paper as defaults, and `hand.opening`.
"""
GREATEST_SEED = 2**31 - 1
"""What a seed may be at most."""


def setting(
    default: Any,
    help: str,
    *,
    unit: str = "",
    least: float | None = None,
    greatest: float | None = None,
    length: int | None = None,
    resource: bool = False,
    later: int = 0,
    formerly: str = "",
) -> Any:
    """A dataclass field with `default` (copied if mutable) and a sentence of help.

    A number has a `unit` (empty: none), and lies between `least` and `greatest`, both allowed; of
    a list or a mapping every number does. A list has `length` entries (None: any number).

    A `resource` setting says how something is computed, never what comes out (threads, devices):
    it never enters a stage's key. `later` is the version of keys (`KEYS_VERSION`) during which the
    setting came. While that version lasts it enters a key only where it is not at its default,
    which must mean what was done before there was such a setting: finished stages keep their
    keys. The next version ends that by itself: the setting enters all keys, and its default may
    change.

    `formerly` is the name that the setting had before. It enters keys under that name, so that
    finished stages keep theirs, and whoever still writes it learns the new name.
    """
    metadata = {
        "help": help,
        "unit": unit,
        "least": least,
        "greatest": greatest,
        "length": length,
        "resource": resource,
        "later": later,
        "formerly": formerly,
    }
    if isinstance(default, type):
        return dataclasses.field(default_factory=default, metadata=metadata)
    if isinstance(default, list | dict):
        return dataclasses.field(default_factory=lambda: copy.deepcopy(default), metadata=metadata)
    return dataclasses.field(default=default, metadata=metadata)


def help_of(cls: type) -> dict[str, str]:
    """The help text of each field of the settings class `cls`."""
    return {field.name: field.metadata.get("help", "") for field in dataclasses.fields(cls)}


def is_resource(field: dataclasses.Field) -> bool:
    """Whether `field` is a resource setting (see `setting`)."""
    return bool(field.metadata.get("resource", False))


def default_of(field: dataclasses.Field) -> Any:
    """The default of `field`, as a value of its own."""
    made = field.default_factory
    return field.default if made is dataclasses.MISSING else made()


def enters_key(field: dataclasses.Field, value: Any) -> bool:
    """Whether a stage's key depends on `field` where it has this value (see `setting`)."""
    if is_resource(field):
        return False
    still_later = field.metadata.get("later", 0) == KEYS_VERSION
    return not (still_later and value == default_of(field))


def key_name(field: dataclasses.Field) -> str:
    """The name under which `field` enters a stage's key (see `setting`)."""
    return field.metadata.get("formerly") or field.name
