"""Cells as all combinations of some axes, less those that are excluded.

    matrix:
      model: finetuned
      axes:
        collision:                         # values by name; '-' is left out of the cell's name
          "-": {losses.weights.collision: 0}
          collision: {losses.weights.collision: 1}
        training.hard_samples: [16, 64]    # or the values of one setting
      exclude:
        - {collision: "-", training.hard_samples: 16}
      cells:                               # what single cells add: label, paper
        collision+hard_samples-64: {paper: {valid: [1.0, 0.0]}}

The name of a cell joins the names of its values by '+'; with all of them '-' it is 'none'.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from typing import Any

from dmfc.errors import DmfcError, unknown_name
from dmfc.sweep.yaml_checks import mapping, shortened

UNNAMED, NOTHING, JOIN = "-", "none", "+"
MOST_CELLS = 2000
"""Most combinations of a matrix, and most cells times seeds of a sweep."""
Values = dict[str, Mapping[str, Any]]
"""Settings by the name of a value."""


def expand(matrix: Mapping[str, Any], where: str) -> dict[str, dict[str, Any]]:
    """Cells by name, in the form in which a sweep file lists them.

    Raises DmfcError on an axis, a value or a cell that does not exist, on two cells of one name,
    and if none is left.
    """
    axes = {str(name): _values(str(name), given, where) for name, given in _axes(matrix, where)}
    combinations = math.prod(len(values) for values in axes.values())
    if combinations > MOST_CELLS:
        raise DmfcError(f"{where}: {combinations:,} combinations, more than {MOST_CELLS:,}")
    excluded = [_exclusion(item, axes, where) for item in _exclusions(matrix, where)]
    added = {
        str(name): mapping(cell or {}, f"{where}: cell '{name}'")
        for name, cell in mapping(matrix.get("cells") or {}, f"{where}: cells").items()
    }
    cells: dict[str, dict[str, Any]] = {}
    for names in itertools.product(*axes.values()):
        chosen = dict(zip(axes, names, strict=True))
        if any(item.items() <= chosen.items() for item in excluded):
            continue
        name = JOIN.join(value for value in names if value != UNNAMED) or NOTHING
        if name in cells:
            raise DmfcError(f"{where}: two combinations are named '{name}'")
        cells[name] = {
            "label": name.replace(JOIN, f" {JOIN} "),
            "model": matrix.get("model", "finetuned"),
            "set": _together(axes, chosen, where),
            **added.pop(name, {}),
        }
    if not cells:
        raise DmfcError(f"{where}: every combination is excluded")
    if added:
        raise DmfcError(f"{where}: cells: {unknown_name('cell', next(iter(added)), cells)}")
    return cells


def _axes(matrix: Mapping[str, Any], where: str) -> list[tuple[str, Any]]:
    axes = matrix.get("axes")
    if not isinstance(axes, Mapping) or not axes:
        raise DmfcError(f"{where}: wants 'axes', each with its values")
    return list(axes.items())


def _exclusions(matrix: Mapping[str, Any], where: str) -> list[Any]:
    excluded = matrix.get("exclude") or []
    if not isinstance(excluded, list):
        raise DmfcError(f"{where}: exclude wants a list of combinations, not {shortened(excluded)}")
    return excluded


def _values(axis: str, given: Any, where: str) -> Values:
    if isinstance(given, list) and given:
        short = axis.rpartition(".")[2]
        return {f"{short}-{value}": {axis: value} for value in given}
    if isinstance(given, Mapping) and given:
        for name, settings in given.items():
            if not isinstance(settings, Mapping | None):
                raise DmfcError(
                    f"{where}: {axis}: {name} wants settings, not {shortened(settings)}"
                )
        return {str(name): settings or {} for name, settings in given.items()}
    raise DmfcError(
        f"{where}: {axis} wants a list of values, or values by name, not {shortened(given)}"
    )


def _exclusion(item: Any, axes: Mapping[str, Values], where: str) -> dict[str, str]:
    """The names of the values that are not to be combined."""
    where = f"{where}: exclude"
    if not isinstance(item, Mapping) or not item:
        raise DmfcError(f"{where}: wants axes with a value each, not {shortened(item)}")
    found = {}
    for axis, value in item.items():
        if axis not in axes:
            raise DmfcError(f"{where}: {unknown_name('axis', str(axis), axes)}")
        names = [
            name
            for name, settings in axes[axis].items()
            if str(value) == name or settings == {axis: value}
        ]
        if not names:
            raise DmfcError(f"{where}: {unknown_name(f'value of {axis}', str(value), axes[axis])}")
        found[str(axis)] = names[0]
    return found


def _together(axes: Mapping[str, Values], chosen: Mapping[str, str], where: str) -> dict[str, Any]:
    settings: dict[str, Any] = {}
    for axis, name in chosen.items():
        for key, value in axes[axis][name].items():
            if key in settings:
                raise DmfcError(f"{where}: two axes set '{key}'")
            settings[key] = value
    return settings
