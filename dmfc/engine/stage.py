"""A stage: one folder of outputs as a pure function of settings, inputs and code version."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, TypeVar

from dmfc.config.setting import KEYS_VERSION, enters_key, key_name
from dmfc.files.digest import text_digest

T = TypeVar("T")
KEY_LENGTH = 32
"""Hexadecimal digits of a key: 128 bits of its SHA-256."""


@dataclass(frozen=True, eq=False)
class Stage:
    """One node of the graph.

    `config` maps names to settings dataclasses or plain values: all that the stage depends on
    besides `inputs`. `inputs` maps names to a stage or several. `name` is for people, `hints` say
    where data lies on this machine: neither is part of the key, so stages that compute the same
    thing under two names are one stage.
    """

    kind: str
    name: str
    version: int
    config: Mapping[str, Any] = field(default_factory=dict)
    inputs: Mapping[str, Stage | tuple[Stage, ...]] = field(default_factory=dict)
    hints: Mapping[str, str] = field(default_factory=dict)

    @cached_property
    def key(self) -> str:
        """Hash of kind, version, settings and the keys of the inputs."""
        return key_of(self.kind, self.version, plain(self.config), self.input_keys)

    @cached_property
    def input_keys(self) -> dict[str, Any]:
        """'kind/key' of each input, in the structure of `inputs`."""
        return {
            name: [stage.address for stage in given] if isinstance(given, tuple) else given.address
            for name, given in self.inputs.items()
        }

    @property
    def address(self) -> str:
        """'kind/key': where the stage lies in any ledger."""
        return f"{self.kind}/{self.key}"

    @cached_property
    def parents(self) -> tuple[Stage, ...]:
        """The inputs, each once."""
        flat: dict[str, Stage] = {}
        for given in self.inputs.values():
            for stage in given if isinstance(given, tuple) else (given,):
                flat[stage.address] = stage
        return tuple(flat.values())


def closure(targets: Iterable[Stage]) -> list[Stage]:
    """The targets and all they need, each once (by address), inputs before their users."""
    ordered: dict[str, Stage] = {}
    stack = [(stage, False) for stage in reversed(list(targets))]
    while stack:
        stage, expanded = stack.pop()
        if stage.address in ordered:
            continue
        if expanded:
            ordered[stage.address] = stage
        else:
            stack.append((stage, True))
            stack.extend((parent, False) for parent in reversed(stage.parents))
    return list(ordered.values())


def key_of(kind: str, version: int, config: Any, inputs: Any) -> str:
    """The hash of what makes a stage what it is, from `plain` settings and its inputs' keys."""
    identity = {
        "keys": KEYS_VERSION,
        "kind": kind,
        "version": version,
        "config": config,
        "inputs": inputs,
    }
    text = json.dumps(identity, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return text_digest(text)[:KEY_LENGTH]


def plain(value: Any) -> Any:
    """`value` as JSON's types, as it enters a key (`setting`); whole floats stay floats.

    Raises TypeError on anything that has no stable text form.
    """
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {
            key_name(item): plain(getattr(value, item.name))
            for item in dataclasses.fields(value)
            if enters_key(item, getattr(value, item.name))
        }
    if isinstance(value, Mapping):
        return {str(name): plain(item) for name, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, Path):
        return str(value)
    if value is None or isinstance(value, bool | int | float | str):
        return value
    raise TypeError(f"{type(value).__name__} cannot be part of a stage's key")


def without(settings: T, *fields: str) -> T:
    """`settings` with those fields back at their defaults."""
    fresh = {}
    for item in dataclasses.fields(settings):  # type: ignore[arg-type]
        if item.name in fields:
            made = item.default_factory
            fresh[item.name] = item.default if made is dataclasses.MISSING else made()
    if len(fresh) != len(fields):
        raise ValueError(f"{type(settings).__name__} lacks one of {fields}")
    return dataclasses.replace(settings, **fresh)  # type: ignore[type-var]


def differences(old: Any, new: Any, prefix: str = "") -> Iterator[str]:
    """Lines such as 'losses.weights.collision 1.0 -> 2.0' between two `plain` values."""
    if isinstance(old, dict) and isinstance(new, dict):
        for name in sorted(old.keys() | new.keys()):
            dotted = f"{prefix}.{name}" if prefix else name
            yield from differences(old.get(name), new.get(name), dotted)
    elif old != new:
        yield f"{prefix} {old} -> {new}"
