"""The one boundary where YAML and `key=value` become typed, frozen settings."""

from __future__ import annotations

import dataclasses
import difflib
import typing
from collections.abc import Iterable, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from dmfc.config.interpolation import refuse_interpolation
from dmfc.config.plain_yaml import parse_yaml, read_yaml
from dmfc.config.schema import Config
from dmfc.errors import DmfcError, unknown_name

LIKE = 0.7
"""Least likeness (0 to 1) of a key that is offered instead of an unknown one."""

Overlay = tuple[str, Mapping[str, Any]]
"""Where a set of values came from (for errors), and the values, nested or with dotted keys."""


def load_config(preset: str | None = None, overrides: Sequence[str] = ()) -> Config:
    """The defaults, overlaid by the preset (name or YAML path), then by `key=value` overrides.

    Raises DmfcError on an unknown preset or key (naming the nearest) and on a wrong type.
    """
    overlays = [preset_overlay(preset)] if preset else []
    return build_config([*overlays, *(parse_override(text) for text in overrides)])


def build_config(overlays: Iterable[Overlay], base: Config | None = None) -> Config:
    """The defaults, or `base`, with each overlay merged over them in order."""
    trees = [(where, open_tree(values, where)) for where, values in overlays]
    start = _schema() if base is None else OmegaConf.structured(base)
    try:
        merged = OmegaConf.merge(start, *(tree for _, tree in trees))
    except (OmegaConfBaseException, TypeError):
        raise _culprit(trees) from None
    try:
        return typing.cast(Config, OmegaConf.to_object(merged))
    except (OmegaConfBaseException, ValueError, TypeError) as error:
        raise _one_line(error, "settings", {}) from error


@cache
def _schema() -> DictConfig:
    """The defaults as OmegaConf has them; making them takes longer than all the rest."""
    return OmegaConf.structured(Config)


def parse_override(text: str) -> Overlay:
    """'a.b=3' as an overlay; the value is read as YAML."""
    key, separator, value = text.partition("=")
    if not separator or not key.strip():
        raise DmfcError(f"--set {text}: write it as key=value, for example training.batch_size=4")
    where = f"--set {text}"
    return where, {key.strip(): parse_yaml(value, where)}


def preset_overlay(preset: str) -> Overlay:
    """The overlay of a preset: a name shipped with dmfc, or the path of a YAML file."""
    path = shipped_file("configs", preset, "preset")
    values = read_yaml(path)
    if not isinstance(values, Mapping):
        raise DmfcError(f"preset '{path}' is not a mapping of settings")
    return str(path), values


def shipped_names(folder: str) -> list[str]:
    """Names of the YAML files shipped in `folder` ('configs', 'sweeps' or 'protocols')."""
    return sorted(path.stem for path in _shipped_folder(folder).glob("*.yaml"))


def shipped_file(folder: str, name: str, what: str) -> Path:
    """The path of a shipped YAML file by its name, or of the user's own by its path."""
    path = Path(name)
    if path.suffix in (".yaml", ".yml") or len(path.parts) > 1:
        if path.is_file():
            return path
        shipped = _shipped_folder(folder) / path.name
        if path.parts[:-1] == (folder,) and shipped.is_file():
            return shipped
        raise DmfcError(f"{what} file '{name}' does not exist")
    shipped = _shipped_folder(folder) / f"{name}.yaml"
    if not shipped.is_file():
        raise unknown_name(what, name, shipped_names(folder))
    return shipped


def _shipped_folder(folder: str) -> Path:
    """`folder` inside an installed wheel, or at the top of a checkout."""
    package = Path(__file__).resolve().parents[1]
    for candidate in (package / folder, package.parent / folder):
        if candidate.is_dir():
            return candidate
    raise DmfcError(f"this installation of dmfc lacks its '{folder}' folder: install it again")


@cache
def all_keys() -> dict[str, type | None]:
    """Every dotted key of the settings, and its settings class (None for a single value)."""
    keys: dict[str, type | None] = {}

    def walk(cls: type, prefix: str) -> None:
        hints = typing.get_type_hints(cls)
        for field in dataclasses.fields(cls):
            kind = hints[field.name]
            group = kind if dataclasses.is_dataclass(kind) else None
            keys[prefix + field.name] = typing.cast("type | None", group)
            if group is not None:
                walk(typing.cast(type, group), f"{prefix}{field.name}.")

    walk(Config, "")
    return keys


def nearest_key(key: str, choices: Iterable[str]) -> str | None:
    """The choice most like `key`, by the whole of it or by its last part; None if none is."""

    def likeness(choice: str) -> float:
        whole = difflib.SequenceMatcher(None, key, choice).ratio()
        parts = key.rpartition(".")[2], choice.rpartition(".")[2]
        return max(whole, difflib.SequenceMatcher(None, *parts).ratio())

    best = max(choices, key=likeness, default=None)
    return best if best is not None and likeness(best) >= LIKE else None


def open_tree(values: Mapping[str, Any], where: str) -> dict[str, Any]:
    """`values` with dotted keys opened out, after checking every key against the schema."""
    refuse_interpolation(values, where)
    root: dict[str, Any] = {}

    def put(prefix: str, node: Mapping[Any, Any]) -> None:
        for name, value in node.items():
            key = f"{prefix}{name}"
            if key not in all_keys():
                near = nearest_key(key, all_keys())
                hint = f"; did you mean '{near}'?" if near else ""
                raise DmfcError(f"{where}: unknown setting '{key}'{hint}")
            group = all_keys()[key]
            if group is None:
                _assign(root, key, value, where)
            elif isinstance(value, Mapping):
                put(f"{key}.", value)
            elif value is not None:
                raise DmfcError(f"{where}: '{key}' is a group of settings, not a value ({value!r})")

    put("", values)
    return root


def _assign(root: dict[str, Any], key: str, value: Any, where: str) -> None:
    *groups, last = key.split(".")
    for group in groups:
        root = root.setdefault(group, {})
    if last in root:
        raise DmfcError(f"{where}: '{key}' is given twice")
    root[last] = value


def _culprit(trees: Sequence[tuple[str, dict[str, Any]]]) -> DmfcError:
    """The error of the first overlay that cannot be merged by itself."""
    for where, tree in trees:
        try:
            OmegaConf.merge(_schema(), tree)
        except (OmegaConfBaseException, TypeError) as error:
            return _one_line(error, where, tree)
    return DmfcError("the settings contradict each other")


def _one_line(error: Exception, where: str, tree: dict[str, Any]) -> DmfcError:
    """OmegaConf's several lines as one, with the key and what the key wants."""
    key = str(getattr(error, "full_key", None) or "")
    message = str(error).splitlines()[0].rstrip(".")
    if "AnyNode is not a ListConfig" in message:
        value: Any = tree
        for part in key.split("."):
            value = value.get(part) if isinstance(value, Mapping) else None
        message = f"wants a list such as [a, b], not {value!r}"
    return DmfcError(f"{where}: {key}: {message}" if key else f"{where}: {message}")
