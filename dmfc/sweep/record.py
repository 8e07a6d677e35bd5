"""The record of a sweep, `sweep.json`, from which tables, pages and tracking are made."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from dmfc.errors import DmfcError, first_line
from dmfc.files.sealed import DamagedError, read_sealed, write_sealed

SWEEP = "sweep.json"
VERSION = 2
"""Since which it holds its own digest."""
_PERHAPS = ("search", "over")


@dataclass(frozen=True)
class DataRecord:
    """A scene set that a cell learns from or is tested on."""

    context: str
    """'training' or 'testing'."""
    name: str
    stages: tuple[str, ...]
    """Addresses of its shards."""


@dataclass(frozen=True)
class CellRecord:
    """One cell at one seed. Stages are named by their addresses."""

    name: str
    label: str
    kind: str
    """Where its grasps come from: pretrained, finetuned, planner or random."""
    seed: int
    trials: int
    """K x scenes: the denominator of its rates; 0 for a trial of a search (it is not executed)."""
    model: str | None
    pretrain: str | None
    """The stage whose weights a fine-tuned model starts from."""
    evaluations: tuple[str, ...]
    """One per shard of test scenes."""
    config: Mapping[str, Any]
    grasps_per_scene: int = 0
    paper: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    """Rate -> (value, standard error) as the article prints them."""
    objective: Mapping[str, float] = field(default_factory=dict)
    """Of a trial of a search: validation measure -> weight; empty for all other cells."""
    data: tuple[DataRecord, ...] = ()

    @property
    def run(self) -> str:
        """'all-seed0': the name of its run in MLflow."""
        return f"{self.name}-seed{self.seed}"

    @property
    def stages(self) -> tuple[str, ...]:
        """Its stages, in the order in which they run, each once."""
        wanted = (self.pretrain, self.model, *self.evaluations)
        return tuple(dict.fromkeys(address for address in wanted if address))


@dataclass(frozen=True)
class SearchRecord:
    """What is known of a search yet."""

    objective: Mapping[str, float]
    """Validation measure -> its weight in the sum that is maximised."""
    space: Mapping[str, Any]
    """Setting -> its range, or its choices."""
    wanted: int
    """Trials that it is to make."""
    trials: tuple[Mapping[str, Any], ...] = ()
    """The settings of each trial so far."""
    best: int | None = None
    """Number of the best trial, once all are made."""


@dataclass(frozen=True)
class SweepRecord:
    """A sweep as its cells and their stages."""

    id: str
    name: str
    title: str
    file: str
    preset: str | None
    baseline: str
    """The cell with which others are compared."""
    show: tuple[str, ...]
    """Rates that the table shows."""
    cells: tuple[CellRecord, ...]
    stages: Mapping[str, str]
    """Address -> name of every stage, inputs of inputs too."""
    search: SearchRecord | None = None
    over: tuple[str, ...] = ()
    """Settings over which the figure shows the rate."""

    @property
    def targets(self) -> tuple[str, ...]:
        """Addresses of the stages that the cells name; all others are their inputs."""
        return tuple(dict.fromkeys(address for cell in self.cells for address in cell.stages))

    def to_json(self) -> dict[str, Any]:
        """As it is written; `search` and `over` are left out of a sweep that has none."""
        values = {**dataclasses.asdict(self), "version": VERSION}
        return {name: value for name, value in values.items() if name not in _PERHAPS or value}

    def save(self, folder: Path) -> None:
        """Write `sweep.json` into the sweep's folder, which is made."""
        folder.mkdir(parents=True, exist_ok=True)
        write_sealed(folder / SWEEP, VERSION, self.to_json())

    @classmethod
    def load(cls, folder: Path) -> SweepRecord:
        """Read what `save` wrote. Raises DmfcError on one line where that is damaged."""
        path = folder / SWEEP
        try:
            return cls.of_json(read_sealed(path, VERSION))
        except DamagedError as error:
            raise DamagedError(
                f"{error}: run the same `dmfc sweep` again, which writes it"
            ) from error
        except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
            raise DmfcError(
                f"'{path}' is no record of a sweep that this version of dmfc reads "
                f"({first_line(error)}): run the same `dmfc sweep` again"
            ) from error

    @classmethod
    def of_json(cls, values: Mapping[str, Any]) -> SweepRecord:
        """The record of `to_json`. Raises ValueError, KeyError or TypeError for anything else."""
        rest = dict(values)
        version = rest.pop("version")
        if version not in (1, VERSION):
            raise ValueError(f"version {version}, not {VERSION}")
        cells = tuple(_cell(cell) for cell in rest.pop("cells"))
        search = rest.pop("search", None)
        show, over = tuple(rest.pop("show")), tuple(rest.pop("over", ()))
        found = None if search is None else _search(search)
        return cls(cells=cells, search=found, show=show, over=over, **rest)


def _cell(values: Mapping[str, Any]) -> CellRecord:
    rest = dict(values)
    evaluations = tuple(rest.pop("evaluations"))
    paper = {name: (value, error) for name, (value, error) in rest.pop("paper", {}).items()}
    data = tuple(
        DataRecord(**{**item, "stages": tuple(item["stages"])}) for item in rest.pop("data", ())
    )
    return CellRecord(evaluations=evaluations, paper=paper, data=data, **rest)


def _search(values: Mapping[str, Any]) -> SearchRecord:
    return SearchRecord(**{**values, "trials": tuple(values["trials"])})
