"""Training seeds of a sweep file: a list, or lists by preset."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from dmfc.config.setting import GREATEST_SEED
from dmfc.config.shipped import check_renamed
from dmfc.errors import DmfcError
from dmfc.sweep.yaml_checks import shortened


def parse_seeds(given: Any, where: str) -> dict[str, tuple[int, ...]]:
    """By preset; '' of those that are not named."""
    if not isinstance(given, Mapping):
        return {"": seed_list(given, where)}
    for name in given:
        check_renamed("configs", str(name), f"{where}: preset")
    found = {str(name): seed_list(value, f"{where}.{name}") for name, value in given.items()}
    return {"": (0,), **found}


def seed_list(given: Any, where: str) -> tuple[int, ...]:
    """A list of seeds. Raises DmfcError on anything else, and on a seed that is given twice."""
    good = isinstance(given, list) and given
    if not good or not all(type(seed) is int and 0 <= seed <= GREATEST_SEED for seed in given):
        raise DmfcError(
            f"{where}: wants a list of whole numbers such as [0, 1], up to {GREATEST_SEED}, "
            f"not {shortened(given)}"
        )
    if len(set(given)) < len(given):
        raise DmfcError(f"{where}: a seed is given twice in {shortened(given)}")
    return tuple(given)
