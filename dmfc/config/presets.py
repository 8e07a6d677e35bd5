"""Presets: files of settings, shipped with dmfc or of the user, laid over each other."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dmfc.config.plain_yaml import read_yaml
from dmfc.config.shipped import shipped_file
from dmfc.errors import DmfcError

EXTENDS = "extends"
"""The key of a preset that names the presets which it is laid over."""
Presets = str | Sequence[str]
"""One preset or several, each a shipped name or the path of a YAML file; the last one wins."""


@dataclass(frozen=True)
class Layer:
    """The settings of one preset file, without those of the presets that it extends."""

    path: Path
    values: Mapping[str, Any]


def preset_layers(presets: Presets | None) -> list[Layer]:
    """The layers of the presets, in the order in which they are laid over the defaults.

    Raises DmfcError where a preset does not exist, is no mapping, or extends itself.
    """
    return [layer for name in preset_names(presets) for layer in _layers(name, ())]


def preset_names(presets: Presets | None) -> list[str]:
    """The presets as a list."""
    names = [presets] if isinstance(presets, str) else presets or []
    return [name for name in names if name]


def preset_title(presets: Presets | None) -> str:
    """The presets as one name, such as 'quick+literal'; empty for the defaults alone."""
    return "+".join(preset_names(presets))


def _layers(name: str, within: tuple[Path, ...]) -> list[Layer]:
    path = shipped_file("configs", name, "preset")
    if path.resolve() in within:
        raise DmfcError(f"preset '{path}' extends itself")
    values = read_yaml(path)
    if not isinstance(values, Mapping):
        raise DmfcError(f"preset '{path}' is not a mapping of settings")
    rest = {key: value for key, value in values.items() if key != EXTENDS}
    below = values.get(EXTENDS) or []
    names = [below] if isinstance(below, str) else below
    if not isinstance(names, list) or not all(isinstance(item, str) for item in names):
        raise DmfcError(f"{path}: extends wants the name of a preset or a list of names")
    within = (*within, path.resolve())
    layers = [layer for item in names for layer in _layers(item, within)]
    return [*layers, Layer(path, rest)]
