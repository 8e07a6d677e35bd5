"""`${...}` of OmegaConf, by which a file could read its user's environment."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from omegaconf import Container, OmegaConf

from dmfc.errors import DmfcError

SIGN = "${"


def refuse_interpolation(values: Any, where: str) -> None:
    """Raises DmfcError if a text anywhere in `values` (plain or OmegaConf's) has `${` in it.

    Files come from others too: a setting that reads a secret and one that sends it somewhere (an
    address) can stand side by side.
    """
    if isinstance(values, Container):
        values = OmegaConf.to_container(values, resolve=False)
    for key, text in _texts(values, ""):
        if SIGN in text:
            at = f"'{key}' is" if key else "is"
            raise DmfcError(
                f"{where}: {at} '{text}': '{SIGN}' is not allowed in settings (it could read the "
                "environment); write the value itself"
            )


def _texts(value: Any, key: str) -> Iterator[tuple[str, str]]:
    """Each text with its dotted key; keys that are texts too."""
    if isinstance(value, str):
        yield key, value
    elif isinstance(value, Mapping):
        for name, item in value.items():
            yield key, str(name)
            yield from _texts(item, f"{key}.{name}".lstrip("."))
    elif isinstance(value, Sequence) and not isinstance(value, bytes):
        for item in value:
            yield from _texts(item, key)
