"""A sweep file: a base, named cells, seeds, and the paper's row beside each cell.

    name: table1
    title: One object, random pose
    base: {scenes.test.kind: single}
    presets:
      paper: {scenes.train.count: 1000}
    seeds: [0]
    cells:
      all:
        label: fine-tuned, all
        model: finetuned
        set: {losses.weights.q1_upper: 1}
        paper: {valid: [0.82, 0.02], success: [0.68, 0.02], overall: [0.56, 0.02]}

Settings are laid over each other in this order: defaults, preset, `base`, `presets.<preset>`,
what the command line sets, the cell's `set`. Rows for the planner and for random grasps are always
added.
"""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from dmfc.config.load import (
    build_config,
    nearest_key,
    parse_override,
    preset_overlay,
    shipped_file,
)
from dmfc.config.plain_yaml import read_yaml
from dmfc.config.schema import Config
from dmfc.errors import DmfcError, unknown_name

MODELS = ("pretrained", "finetuned", "planner", "random")
RATES = ("valid", "success", "overall")
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.+-]*")


@dataclass(frozen=True)
class Cell:
    """One row of the table: a model, or the planner's or random grasps, and its settings."""

    name: str
    label: str
    model: str
    settings: Mapping[str, Any] = field(default_factory=dict)
    paper: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    """Rate name -> (value, standard error) as printed in the paper."""


@dataclass(frozen=True)
class Sweep:
    """A parsed sweep file."""

    path: Path
    name: str
    title: str
    base: Mapping[str, Any]
    presets: Mapping[str, Mapping[str, Any]]
    seeds: tuple[int, ...]
    cells: tuple[Cell, ...]


def load_sweep(name: str) -> Sweep:
    """The sweep file at a path, or shipped under a name. Raises DmfcError on anything odd in it."""
    path = shipped_file("sweeps", name, "sweep")
    values = _mapping(read_yaml(path), str(path))
    _known(values, ("name", "title", "base", "presets", "seeds", "cells"), str(path))
    cells = _cells(values.get("cells"), str(path))
    present = {cell.model for cell in cells}
    rows = [row for row in (PLANNER_ROW, RANDOM_ROW) if row.model not in present]
    taken = {cell.name for cell in cells}
    for row in rows:
        if row.name in taken:
            raise DmfcError(
                f"{path}: cell '{row.name}' must have model: {row.model}, or another name"
            )
    return Sweep(
        path=path,
        name=_name(values.get("name", path.stem), f"{path}: name"),
        title=str(values.get("title", path.stem)),
        base=_mapping(values.get("base") or {}, f"{path}: base"),
        presets=_presets(values.get("presets") or {}, f"{path}: presets"),
        seeds=_seeds(values.get("seeds", [0]), f"{path}: seeds"),
        cells=(*cells, *rows),
    )


PLANNER_ROW = Cell("planner", "planner (ceiling)", "planner")
RANDOM_ROW = Cell("random", "random (floor)", "random")


def cell_config(
    sweep: Sweep, cell: Cell, seed: int, preset: str | None, overrides: Sequence[str]
) -> Config:
    """The settings of one cell at one seed, checked; errors name the file and the cell."""
    overlays = [preset_overlay(preset)] if preset else []
    overlays.append((f"{sweep.path}: base", sweep.base))
    additions = sweep.presets.get(Path(preset or "").stem)
    if additions:
        overlays.append((f"{sweep.path}: presets.{Path(preset or '').stem}", additions))
    overlays += [parse_override(text) for text in overrides]
    overlays.append((f"{sweep.path}: cell '{cell.name}'", cell.settings))
    config = build_config(overlays)
    return dataclasses.replace(
        config,
        training=dataclasses.replace(config.training, seed=seed),
        execution=dataclasses.replace(config.execution, seed=seed),
    )


def _cells(given: Any, where: str) -> list[Cell]:
    """Cells as a mapping (name -> cell) or a list of mappings with a `name`."""
    if isinstance(given, Mapping):
        named = [(str(name), value) for name, value in given.items()]
    elif isinstance(given, list):
        named = []
        for place, value in enumerate(given):
            cell = dict(_mapping(value, f"{where}: cell {place + 1}"))
            if "name" not in cell:
                raise DmfcError(f"{where}: cell {place + 1} has no name")
            named.append((str(cell.pop("name")), cell))
    else:
        named = []
    if not named:
        raise DmfcError(f"{where}: no cells; list at least one under 'cells'")
    seen: set[str] = set()
    for name, _ in named:
        if name in seen:
            raise DmfcError(f"{where}: two cells are named '{name}'")
        seen.add(name)
    return [_cell(name, value, where) for name, value in named]


def _cell(name: str, given: Any, where: str) -> Cell:
    where = f"{where}: cell '{_name(name, where)}'"
    values = _mapping(given or {}, where)
    _known(values, ("label", "model", "set", "paper"), where)
    model = str(values.get("model", "finetuned"))
    if model not in MODELS:
        raise DmfcError(f"{where}: {unknown_name('model', model, MODELS)}")
    return Cell(
        name=name,
        label=str(values.get("label", name)),
        model=model,
        settings=_mapping(values.get("set") or {}, f"{where}: set"),
        paper=_paper(values.get("paper") or {}, f"{where}: paper"),
    )


def _paper(given: Any, where: str) -> dict[str, tuple[float, float]]:
    rates: dict[str, tuple[float, float]] = {}
    values = _mapping(given, where)
    _known(values, RATES, where)
    for name, pair in values.items():
        try:
            value, error = (float(item) for item in pair)
        except (TypeError, ValueError):
            raise DmfcError(f"{where}: {name} wants [value, standard error], not {pair}") from None
        rates[name] = (value, error)
    return rates


def _presets(given: Any, where: str) -> dict[str, Mapping[str, Any]]:
    return {
        str(name): _mapping(value, f"{where}.{name}")
        for name, value in _mapping(given, where).items()
    }


def _seeds(given: Any, where: str) -> tuple[int, ...]:
    good = isinstance(given, list) and given
    if not good or not all(isinstance(seed, int) and seed >= 0 for seed in given):
        raise DmfcError(f"{where}: wants a list of whole numbers such as [0, 1], not {given}")
    if len(set(given)) < len(given):
        raise DmfcError(f"{where}: a seed is given twice in {given}")
    return tuple(given)


def _name(given: Any, where: str) -> str:
    if not isinstance(given, str) or not _NAME.fullmatch(given):
        raise DmfcError(f"{where}: '{given}' is no name; use letters, digits and _ . + -")
    return given


def _mapping(value: Any, where: str) -> Mapping[str, Any]:
    if not isinstance(value, Mapping):
        raise DmfcError(f"{where}: wants 'key: value' pairs, not {value!r}")
    return value


def _known(values: Mapping[str, Any], allowed: Sequence[str], where: str) -> None:
    for name in values:
        if name not in allowed:
            near = nearest_key(str(name), allowed)
            hint = f"; did you mean '{near}'?" if near else f" (known: {', '.join(allowed)})"
            raise DmfcError(f"{where}: unknown key '{name}'{hint}")
