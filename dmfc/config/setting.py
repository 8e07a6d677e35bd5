"""`setting`: a dataclass field that carries its own help text."""

from __future__ import annotations

import copy
import dataclasses
from typing import Any


def setting(default: Any, help: str) -> Any:
    """A dataclass field with `default` (copied if mutable) and a sentence of help."""
    metadata = {"help": help}
    if isinstance(default, type):
        return dataclasses.field(default_factory=default, metadata=metadata)
    if isinstance(default, list | dict):
        return dataclasses.field(default_factory=lambda: copy.deepcopy(default), metadata=metadata)
    return dataclasses.field(default=default, metadata=metadata)
