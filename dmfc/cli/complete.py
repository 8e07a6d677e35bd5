"""Completion in the shell: names of presets, settings, sweeps, models and protocols."""

from __future__ import annotations

from collections.abc import Iterable


def presets(incomplete: str) -> list[str]:
    """Names of shipped presets."""
    from dmfc.config.shipped import shipped_names

    return _starting(shipped_names("configs"), incomplete)


def overrides(incomplete: str) -> list[str]:
    """Keys of settings as 'key='; after the '=', the values of a setting that has choices."""
    from dmfc.config.load import all_keys

    key, separator, value = incomplete.partition("=")
    if separator:
        return [f"{key}={choice}" for choice in _starting(_choices(key), value)]
    return [f"{name}=" for name in _starting(_values(all_keys()), incomplete)]


def keys(incomplete: str) -> list[str]:
    """Keys of settings and of their groups."""
    from dmfc.config.load import all_keys

    return _starting(all_keys(), incomplete)


def sweeps(incomplete: str) -> list[str]:
    """Names of shipped sweeps."""
    from dmfc.config.shipped import shipped_names

    return _starting(shipped_names("sweeps"), incomplete)


def protocols(incomplete: str) -> list[str]:
    """Names of shipped protocols."""
    from dmfc.config.shipped import shipped_names

    return _starting(shipped_names("protocols"), incomplete)


def models(incomplete: str) -> list[str]:
    """Names of shipped models."""
    from dmfc.prediction.models import shipped_models

    return _starting(shipped_models(), incomplete)


def _values(groups: dict[str, type | None]) -> list[str]:
    return [key for key, group in groups.items() if group is None]


def _choices(key: str) -> list[str]:
    import typing

    from dmfc.config.ranges import all_types

    kind = all_types().get(key)
    if kind is bool:
        return ["true", "false"]
    return [str(item) for item in typing.get_args(kind)] if is_choice(kind) else []


def is_choice(kind: object) -> bool:
    """Whether a setting has a list of choices."""
    import typing

    return typing.get_origin(kind) is typing.Literal


def _starting(names: Iterable[str], incomplete: str) -> list[str]:
    return [name for name in names if name.startswith(incomplete)]
