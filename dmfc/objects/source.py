"""The record of one object that can be prepared, wherever it comes from, and its name."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import trimesh


@dataclass(frozen=True)
class ObjectSource:
    """One object that can be prepared."""

    id: str
    """"<source>/<name>", e.g. "ycb/mug"."""
    licence: str
    mass: float | None
    """kg where it is known, else None: the setting objects.prepare.density gives it."""
    digest: str
    """Changes if what `load` returns may change."""
    selector: str
    """Selects this object alone, on this machine."""
    loader: Callable[[], trimesh.Trimesh]

    @property
    def source(self) -> str:
        return self.id.split("/", 1)[0]

    def load(self) -> trimesh.Trimesh:
        """The mesh as the source has it, in metres. Raises DmfcError if it cannot be read."""
        return self.loader()


def as_name(text: str) -> str:
    """A text as an object's name: letters, marks and digits of any script, and _ . - stay."""
    kept = [
        letter if letter in "_.-" or unicodedata.category(letter)[0] in "LMN" else " "
        for letter in unicodedata.normalize("NFC", text)
    ]
    return re.sub(" +", "-", "".join(kept))
