"""The one boundary where YAML and `key=value` become typed, frozen settings."""

from __future__ import annotations

import dataclasses
import difflib
import typing
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import cache
from typing import Any, TypeVar

from omegaconf import OmegaConf
from omegaconf.errors import OmegaConfBaseException

from dmfc.config.interpolation import refuse_interpolation
from dmfc.config.plain_yaml import parse_yaml
from dmfc.config.presets import Presets, preset_layers
from dmfc.config.ranges import all_types, fault, former_keys
from dmfc.config.schema import Config
from dmfc.errors import DmfcError, first_line

T = TypeVar("T")
LIKE = 0.7
"""Least likeness (0 to 1) of a key that is offered instead of an unknown one."""

Overlay = tuple[str, Mapping[str, Any]]
"""Where a set of values came from (for errors), and the values, nested or with dotted keys."""


def load_config(presets: Presets | None = None, overrides: Sequence[str] = ()) -> Config:
    """The defaults, overlaid by each preset in order, then by `key=value` overrides.

    Raises DmfcError on an unknown preset or key (naming the nearest), a wrong type, or a value
    out of its range.
    """
    overlays = [(str(layer.path), layer.values) for layer in preset_layers(presets)]
    return build_config([*overlays, *(parse_override(text) for text in overrides)])


def build_config(overlays: Iterable[Overlay], base: Config | None = None) -> Config:
    """The defaults, or `base`, with each overlay laid over them in order.

    Raises DmfcError on an unknown key (naming the nearest), a wrong type, or a value out of its
    range; the error names the overlay and the key.
    """
    config = Config() if base is None else base
    values: dict[str, Any] = {}
    for where, given in overlays:
        values |= checked(given, where, config, values)
    try:
        return _replaced(config, values, "")
    except ValueError as error:
        raise DmfcError(f"settings: {error}") from error


def checked(
    given: Mapping[str, Any],
    where: str,
    base: Config | None = None,
    over: Mapping[str, Any] | None = None,
) -> dict[str, Any]:
    """The settings of an overlay by dotted key, each of its type and in its range.

    Raises DmfcError as `build_config`. A mapping is laid over that of `over`, or else of `base`.
    """
    base, over = base or Config(), over or {}
    return {
        key: _converted(key, raw, over[key] if key in over else value_of(base, key), where)
        for key, raw in leaves(open_tree(given, where))
    }


def value_of(config: Config, key: str) -> Any:
    """The value of a dotted key."""
    value: Any = config
    for name in key.split("."):
        value = getattr(value, name)
    return value


def _replaced(group: T, values: Mapping[str, Any], prefix: str) -> T:
    """A group of settings with those of `values`, by dotted key, that lie in it."""
    changed = {}
    for field in dataclasses.fields(group):  # type: ignore[arg-type]
        key = prefix + field.name
        if key in values:
            changed[field.name] = values[key]
        elif any(name.startswith(f"{key}.") for name in values):
            changed[field.name] = _replaced(getattr(group, field.name), values, f"{key}.")
    return dataclasses.replace(group, **changed)  # type: ignore[type-var]


@cache
def _holder(key: str) -> type:
    """A class of one field, `value`, that OmegaConf converts as it would the setting."""
    return dataclasses.make_dataclass("Holder", [("value", all_types()[key])])


def _converted(key: str, raw: Any, current: Any, where: str) -> Any:
    """A value as the type of its setting; a mapping is laid over the `current` one."""
    holder = OmegaConf.structured(_holder(key)(current))
    try:
        merged = OmegaConf.merge(holder, {"value": raw})
        value = typing.cast(dict[str, Any], OmegaConf.to_container(merged, resolve=True))["value"]
    except (OmegaConfBaseException, TypeError, ValueError, OverflowError) as error:
        raise _explained(error, where, key, raw) from error
    wrong = fault(key, raw, value)
    if wrong:
        raise DmfcError(f"{where}: {key} {wrong}")
    return value


def parse_override(text: str) -> Overlay:
    """'a.b=3' as an overlay; the value is read as YAML."""
    key, separator, value = text.partition("=")
    if not separator or not key.strip():
        raise DmfcError(f"--set {text}: write it as key=value, for example training.batch_size=4")
    where = f"--set {text}"
    return where, {key.strip(): parse_yaml(value, where)}


@cache
def all_keys() -> dict[str, type | None]:
    """Every dotted key of the settings, and its settings class (None for a single value)."""
    return {
        key: typing.cast(type, kind) if dataclasses.is_dataclass(kind) else None
        for key, kind in all_types().items()
    }


def nearest_key(key: str, choices: Iterable[str]) -> str | None:
    """The choice most like `key`, by the whole of it or by its last part; None if none is."""

    def likeness(choice: str) -> float:
        whole = difflib.SequenceMatcher(None, key, choice).ratio()
        parts = key.rpartition(".")[2], choice.rpartition(".")[2]
        return max(whole, difflib.SequenceMatcher(None, *parts).ratio())

    best = max(choices, key=likeness, default=None)
    return best if best is not None and likeness(best) >= LIKE else None


def key_hint(key: str) -> str:
    """The end of an error about an unknown key: its present name, the nearest one, or nothing."""
    if key in former_keys():
        return f", which is now called '{former_keys()[key]}'"
    near = nearest_key(key, all_keys())
    return f"; did you mean '{near}'?" if near else ""


def open_tree(values: Mapping[str, Any], where: str) -> dict[str, Any]:
    """`values` with dotted keys opened out, after checking every key against the schema."""
    refuse_interpolation(values, where)
    root: dict[str, Any] = {}

    def put(prefix: str, node: Mapping[Any, Any]) -> None:
        for name, value in node.items():
            key = f"{prefix}{name}"
            if key not in all_keys():
                raise DmfcError(f"{where}: unknown setting '{key}'{key_hint(key)}")
            group = all_keys()[key]
            if group is None:
                _assign(root, key, value, where)
            elif isinstance(value, Mapping):
                put(f"{key}.", value)
            elif value is not None:
                raise DmfcError(f"{where}: '{key}' is a group of settings, not a value ({value!r})")

    put("", values)
    return root


def leaves(tree: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Each setting of a tree of groups with its value, by its dotted key."""
    for name, value in tree.items():
        key = f"{prefix}{name}"
        if all_keys()[key] is None:
            yield key, value
        else:
            yield from leaves(value, f"{key}.")


def _assign(root: dict[str, Any], key: str, value: Any, where: str) -> None:
    *groups, last = key.split(".")
    for group in groups:
        root = root.setdefault(group, {})
    if last in root:
        raise DmfcError(f"{where}: '{key}' is given twice")
    root[last] = value


def _explained(error: Exception, where: str, key: str, raw: Any) -> DmfcError:
    """OmegaConf's several lines as one, with the key and what the key wants."""
    place = str(getattr(error, "full_key", None) or "value").removeprefix("value")
    message = first_line(error).rstrip(".")
    if typing.get_origin(all_types()[key]) is list and not isinstance(raw, list):
        message = f"wants a list such as [a, b], not {raw!r}"
    return DmfcError(f"{where}: {key}{place}: {message}")
