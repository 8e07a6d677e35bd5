"""All settings with their meaning, unit, range, default, value, and where the value came from."""

from __future__ import annotations

import dataclasses
import json
import textwrap
import typing
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from dmfc.config.load import (
    Overlay,
    all_keys,
    build_config,
    key_hint,
    leaves,
    open_tree,
    parse_override,
    value_of,
)
from dmfc.config.presets import Presets, preset_layers
from dmfc.config.ranges import all_fields, all_types, range_text
from dmfc.config.schema import Config
from dmfc.errors import DmfcError

DEFAULT = "default"


@dataclass(frozen=True)
class Described:
    """One setting, and its value under some presets and `--set`."""

    key: str
    meaning: str
    unit: str
    range: str
    """'from 0 to 10 s', or the choices; empty if it may be anything of its type."""
    default: Any
    value: Any
    source: str
    """'default', 'preset quick', or '--set'."""

    @property
    def changed(self) -> bool:
        """Whether the value differs from the default."""
        return bool(self.value != self.default)


def described(
    presets: Presets | None = None, overrides: Sequence[str] = (), selector: str = ""
) -> list[Described]:
    """The settings of a key or a group (empty: all), in the order of the schema.

    Raises DmfcError on an unknown preset, key or selector, and on a wrong value.
    """
    chosen = _selected(selector)
    layers = [(str(layer.path), layer.values) for layer in preset_layers(presets)]
    given: list[Overlay] = [*layers, *(parse_override(text) for text in overrides)]
    names = [f"preset {layer.path.stem}" for layer in preset_layers(presets)]
    config, default, sources = build_config(given), Config(), {}
    for name, (where, values) in zip([*names, *["--set"] * len(overrides)], given, strict=True):
        for key, _ in leaves(open_tree(values, where)):
            sources[key] = name
    return [
        Described(
            key=key,
            meaning=all_fields()[key].metadata["help"],
            unit=all_fields()[key].metadata["unit"],
            range=range_text(key),
            default=value_of(default, key),
            value=value_of(config, key),
            source=sources.get(key, DEFAULT),
        )
        for key in chosen
    ]


def _selected(selector: str) -> list[str]:
    keys = [key for key, group in all_keys().items() if group is None]
    if selector and selector not in all_keys():
        raise DmfcError(f"unknown setting or group '{selector}'{key_hint(selector)}")
    prefix = f"{selector}."
    return [key for key in keys if not selector or key == selector or key.startswith(prefix)]


def as_text(rows: Iterable[Described], width: int) -> Iterator[str]:
    """Lines for a terminal: the value, then the meaning, of each setting."""
    for row in rows:
        default = "" if row.value == row.default else f", default {shown(row.default)}"
        yield f"{row.key} = {shown(row.value)}  ({row.source}{default})"
        limits = f" {row.range[0].upper()}{row.range[1:]}." if row.range else ""
        yield from textwrap.wrap(
            row.meaning + limits, width, initial_indent="    ", subsequent_indent="    "
        )


def as_json(rows: Iterable[Described]) -> list[dict[str, Any]]:
    """The same for a machine, with the least and greatest value as numbers."""
    answer = []
    for row in rows:
        limits = all_fields()[row.key].metadata
        bounds = {"least": limits["least"], "greatest": limits["greatest"]}
        answer.append({**dataclasses.asdict(row), **bounds})
    return answer


def shown(value: Any) -> str:
    """A value as a person writes it in YAML, on one line."""
    if isinstance(value, float):
        return f"{value:.10g}"
    return value if isinstance(value, str) and value else json.dumps(value)


def settings_page() -> str:
    """The page docs/reference/settings.md."""
    lines = [
        "# Settings",
        "",
        "<!-- Written by `make reference` from dmfc/config: do not edit. -->",
        "",
        "Every setting of `dmfc`, with its default. `dmfc config` prints the same for your presets",
        "and `--set`, with the origin of each value; `dmfc config --preset quick --diff` prints",
        "only what differs from the defaults.",
        "",
        "Values are laid over each other in this order: defaults, each `--preset`, `base` and",
        "`presets` of a sweep file, `--set`, `set` of a cell. While grasps are executed, the",
        "protocol (`execution.protocol`) and then `execution.changes` are laid over that.",
    ]
    rows = described()
    for group in _groups():
        members = [row for row in rows if row.key.rpartition(".")[0] == group]
        if members:
            lines += ["", f"## `{group}`", "", all_fields()[group].metadata["help"], ""]
            lines += ["| setting | default | range | meaning |", "|---|---|---|---|"]
            lines += [_table_row(row) for row in members]
    return "\n".join(lines) + "\n"


def _groups() -> list[str]:
    return [key for key, group in all_keys().items() if group is not None]


def _table_row(row: Described) -> str:
    unit = f" {row.unit}" if row.unit else ""
    limits = row.range or _kind(row.key)
    cells = (
        f"`{row.key.rpartition('.')[2]}`",
        f"`{shown(row.default)}`{unit}",
        limits,
        row.meaning,
    )
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


def _kind(key: str) -> str:
    kind = all_types()[key]
    names = {bool: "true or false", str: "text", list: "list of texts", dict: "settings by key"}
    return names[typing.get_origin(kind) or kind]
