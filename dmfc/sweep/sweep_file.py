"""A sweep file: a base, named cells or a matrix of them, seeds, and the paper's row beside each.

    name: table1
    title: One object, random pose
    base: {scenes.test.kind: single}
    presets:
      full: {scenes.train.count: 1000}
    seeds: {full: [0, 1, 2]}   # of that preset, and [0] of all others; or one list for all
    table: {baseline: all, show: [success, overall]}
    cells:
      all:
        label: fine-tuned, all
        model: finetuned
        set: {losses.weights.q1_upper: 1}
        paper: {valid: [0.82, 0.02], success: [0.68, 0.02], overall: [0.56, 0.02]}

Settings are laid over each other in this order: defaults, presets, `base`, `presets.<preset>`,
what the command line sets, the cell's `set`. Rows for the planner and for random grasps are always
added. A cell's `model` is pretrained, finetuned, planner or random; or a trained model that is
executed as it is: a shipped one's name, or a folder; or a method: a shipped one's name, or
`file.py:function`. `matrix` (see `dmfc.sweep.matrix`) adds combinations to the cells or stands in
their place; `kind: search` with a `search` (see `dmfc.sweep.search`) adds trials as they are
suggested.
`table` says which rates are shown, with which cell the others are compared, and over which settings
a figure shows the overall rate (`over`).
"""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from dmfc.config.load import (
    all_keys,
    build_config,
    checked,
    parse_override,
)
from dmfc.config.plain_yaml import read_yaml
from dmfc.config.presets import Presets, preset_layers, preset_names
from dmfc.config.ranges import all_types
from dmfc.config.schema import Config
from dmfc.config.shipped import check_renamed, shipped_file
from dmfc.errors import DmfcError, unknown_name
from dmfc.sweep.matrix import MOST_CELLS, expand
from dmfc.sweep.models import source_of
from dmfc.sweep.search import Search, parse_search
from dmfc.sweep.seeds import parse_seeds, seed_list
from dmfc.sweep.yaml_checks import mapping, only_keys, shortened, text

RATES = ("valid", "success", "overall")
SWEEP_KINDS = ("cells", "search")
KEYS = ("kind", "name", "title", "base", "presets", "seeds", "table", "cells", "matrix", "search")
BEST = "best"
"""The cell of a search that executes its best trial."""
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.+-]{0,99}")


@dataclass(frozen=True)
class Cell:
    """One row of the table: a model, or the planner's or random grasps, and its settings."""

    name: str
    label: str
    model: str
    settings: Mapping[str, Any] = field(default_factory=dict)
    paper: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    """Rate name -> (value, standard error) as printed in the paper."""
    objective: Mapping[str, float] = field(default_factory=dict)
    """Of a trial of a search, which is validated and not executed; empty for all other cells."""
    weights: Path | None = None
    """Folder of a trained model that is executed as it is; None: the cell's own stages."""
    method: str = ""
    """'file.py:function' of a method of the user's own; empty: the cell has none."""


@dataclass(frozen=True)
class Sweep:
    """A parsed sweep file."""

    path: Path
    name: str
    title: str
    base: Mapping[str, Any]
    presets: Mapping[str, Mapping[str, Any]]
    seeds: Mapping[str, tuple[int, ...]]
    """By preset; '' of those that are not named."""
    cells: tuple[Cell, ...]
    baseline: str
    """The cell with which others are compared."""
    show: tuple[str, ...] = RATES
    """Rates that the table shows."""
    over: tuple[str, ...] = ()
    """Settings over which a figure shows the overall rate."""
    search: Search | None = None


def load_sweep(name: str) -> Sweep:
    """The sweep file at a path, or shipped under a name. Raises DmfcError on anything odd in it."""
    path = shipped_file("sweeps", name, "sweep")
    values = mapping(read_yaml(path), str(path))
    only_keys(values, KEYS, str(path))
    search = _search(values, str(path))
    cells = _cells(values, str(path))
    present = {cell.model for cell in cells}
    rows = [row for row in (PLANNER_ROW, RANDOM_ROW) if row.model not in present]
    taken = {cell.name for cell in cells}
    for row in rows:
        if row.name in taken:
            raise DmfcError(
                f"{path}: cell '{row.name}' must have model: {row.model}, or another name"
            )
    if search and (BEST in taken or any(name.startswith("trial-") for name in taken)):
        raise DmfcError(f"{path}: 'best' and 'trial-...' are the cells that a search adds")
    table = mapping(values.get("table") or {}, f"{path}: table")
    only_keys(table, ("baseline", "show", "over"), f"{path}: table")
    names = [cell.name for cell in cells]
    baseline = str(table.get("baseline", names[0]))
    if baseline not in names:
        raise DmfcError(f"{path}: table: {unknown_name('baseline', baseline, names)}")
    seeds = parse_seeds(values.get("seeds", [0]), f"{path}: seeds")
    count = max(map(len, seeds.values())) * len(cells)
    if count > MOST_CELLS:
        raise DmfcError(f"{path}: {count:,} cells and seeds, more than {MOST_CELLS:,}")
    return Sweep(
        path=path,
        name=_name(values.get("name", path.stem), f"{path}: name"),
        title=text(values.get("title", path.stem), f"{path}: title"),
        base=_settings(values.get("base"), f"{path}: base"),
        presets=_presets(values.get("presets") or {}, f"{path}: presets"),
        seeds=seeds,
        cells=(*cells, *rows),
        baseline=baseline,
        show=_shown(table.get("show"), f"{path}: table"),
        over=_over(table.get("over"), f"{path}: table"),
        search=search,
    )


PLANNER_ROW = Cell("planner", "planner (ceiling)", "planner")
RANDOM_ROW = Cell("random", "random (floor)", "random")


def cell_config(
    sweep: Sweep, cell: Cell, seed: int, presets: Presets | None, overrides: Sequence[str]
) -> Config:
    """The settings of one cell at one seed, checked; errors name the file and the cell."""
    overlays = [(str(layer.path), layer.values) for layer in preset_layers(presets)]
    overlays.append((f"{sweep.path}: base", sweep.base))
    # Of the presets that are named, not of those that they extend: these have sizes of their own.
    names = [Path(name).stem for name in preset_names(presets)]
    overlays += [
        (f"{sweep.path}: presets.{name}", sweep.presets[name])
        for name in names
        if name in sweep.presets
    ]
    overlays += [parse_override(text) for text in overrides]
    overlays.append((f"{sweep.path}: cell '{cell.name}'", cell.settings))
    config = build_config(overlays)
    return dataclasses.replace(
        config,
        training=dataclasses.replace(config.training, seed=seed),
        execution=dataclasses.replace(config.execution, seed=seed),
    )


def _search(values: Mapping[str, Any], where: str) -> Search | None:
    kind = str(values.get("kind", "cells"))
    if kind not in SWEEP_KINDS:
        raise DmfcError(f"{where}: {unknown_name('kind of sweep', kind, SWEEP_KINDS)}")
    if (kind == "search") != ("search" in values):
        raise DmfcError(f"{where}: 'kind: search' and the key 'search' belong together")
    return parse_search(values["search"], f"{where}: search") if kind == "search" else None


def _cells(values: Mapping[str, Any], where: str) -> list[Cell]:
    """The cells that the file lists, then those of its matrix."""
    named = _named(values.get("cells"), where)
    if values.get("matrix") is not None:
        if isinstance(values.get("cells"), list):
            raise DmfcError(f"{where}: with a matrix, cells are NAME: {{...}}, not a list")
        matrix = mapping(values["matrix"], f"{where}: matrix")
        only_keys(matrix, ("model", "axes", "exclude", "cells"), f"{where}: matrix")
        named += expand(matrix, f"{where}: matrix").items()
    if not named:
        raise DmfcError(f"{where}: no cells; list at least one under 'cells'")
    seen: set[str] = set()
    for name, _ in named:
        if name in seen:
            raise DmfcError(f"{where}: two cells are named '{name}'")
        seen.add(name)
    return [_cell(name, value, where) for name, value in named]


def _named(given: Any, where: str) -> list[tuple[str, Any]]:
    """Cells as a mapping (name -> cell) or a list of mappings with a `name`."""
    if not isinstance(given, list):
        cells = mapping(given or {}, f"{where}: cells")
        return [(str(name), value) for name, value in cells.items()]
    named = []
    for place, value in enumerate(given):
        cell = dict(mapping(value, f"{where}: cell {place + 1}"))
        if "name" not in cell:
            raise DmfcError(f"{where}: cell {place + 1} has no name")
        named.append((str(cell.pop("name")), cell))
    return named


def _cell(name: str, given: Any, where: str) -> Cell:
    where = f"{where}: cell '{_name(name, where)}'"
    values = mapping(given or {}, where)
    only_keys(values, ("label", "model", "set", "paper"), where)
    model = str(values.get("model", "finetuned"))
    source = source_of(model, where)
    return Cell(
        name=name,
        label=text(values.get("label", name), f"{where}: label"),
        model=source.kind,
        weights=source.weights,
        method=source.method,
        settings=mapping(values.get("set") or {}, f"{where}: set"),
        paper=_paper(values.get("paper") or {}, f"{where}: paper"),
    )


def _paper(given: Any, where: str) -> dict[str, tuple[float, float]]:
    rates: dict[str, tuple[float, float]] = {}
    values = mapping(given, where)
    only_keys(values, RATES, where)
    for name, pair in values.items():
        try:
            value, error = (float(item) for item in pair)
        except (TypeError, ValueError):
            raise DmfcError(f"{where}: {name} wants [value, standard error], not {pair}") from None
        if not (0 <= value <= 1 and 0 <= error <= 1):  # NaN neither
            raise DmfcError(f"{where}: {name}: rate and error lie between 0 and 1, not {pair}")
        rates[name] = (value, error)
    return rates


def _shown(given: Any, where: str) -> tuple[str, ...]:
    if given is None:
        return RATES
    if not isinstance(given, list) or not given:
        raise DmfcError(f"{where}: show wants a list of rates, not {given!r}")
    for name in given:
        if name not in RATES:
            raise DmfcError(f"{where}: {unknown_name('rate', str(name), RATES)}")
    if len(set(given)) < len(given):
        raise DmfcError(f"{where}: show names a rate twice: {given}")
    return tuple(given)


def _over(given: Any, where: str) -> tuple[str, ...]:
    """Dotted keys of settings that are numbers."""
    if not isinstance(given or [], list):
        raise DmfcError(f"{where}: over wants a list of settings, not {shortened(given)}")
    for key in given or []:
        if all_keys().get(key, dict) is not None or all_types()[key] not in (int, float):
            numbers = [name for name, kind in all_types().items() if kind in (int, float)]
            raise DmfcError(f"{where}: over: {unknown_name('number', str(key), numbers)}")
    return tuple(given or ())


def _presets(given: Any, where: str) -> dict[str, Mapping[str, Any]]:
    for name in mapping(given, where):
        check_renamed("configs", str(name), f"{where}: preset")
    return {
        str(name): _settings(value, f"{where}.{name}")
        for name, value in mapping(given, where).items()
    }


def _settings(given: Any, where: str) -> Mapping[str, Any]:
    """Settings, each of which exists and lies in its range."""
    values = mapping(given or {}, where)
    checked(values, where)
    return values


def seeds_of(sweep: Sweep, presets: Presets | None) -> tuple[int, ...]:
    """The seeds of a sweep under its presets: those of the last one that it names seeds for."""
    names = [Path(name).stem for name in preset_names(presets)]
    return next(
        (sweep.seeds[name] for name in reversed(names) if name in sweep.seeds), sweep.seeds[""]
    )


def with_seeds(sweep: Sweep, seeds: Sequence[int]) -> Sweep:
    """The sweep at these seeds, whatever its presets. Raises DmfcError on an odd list."""
    return dataclasses.replace(sweep, seeds={"": seed_list(list(seeds), "seeds")})


def _name(given: Any, where: str) -> str:
    if not isinstance(given, str) or not _NAME.fullmatch(given):
        raise DmfcError(
            f"{where}: '{shortened(given)}' is no name; use up to 100 letters, digits and _ . + -"
        )
    return given
