"""A sweep file and a preset, resolved into the stages of every cell."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from dmfc.config.presets import Presets, preset_title
from dmfc.config.schema import Config
from dmfc.engine.ledger import Ledger
from dmfc.engine.stage import Stage, closure, plain
from dmfc.errors import masked
from dmfc.files.digest import json_digest
from dmfc.pipeline.graph import CellStages, GraphBuilder
from dmfc.sweep.record import CellRecord, DataRecord, SearchRecord, SweepRecord
from dmfc.sweep.sweep_file import Cell, Sweep, cell_config


@dataclass(frozen=True)
class CellPlan:
    """One cell at one seed."""

    cell: Cell
    seed: int
    config: Config
    stages: CellStages

    @property
    def trials(self) -> int:
        """K x scenes: the denominator of its rates, whatever becomes of its stages; 0: a trial."""
        if self.cell.objective:
            return 0
        return self.config.execution.grasps_per_scene * self.config.scenes.test.count

    @property
    def identity(self) -> list[Any]:
        """What it computes, under which name."""
        return [self.cell.name, self.seed, [stage.key for stage in self.stages.evaluations]]


@dataclass(frozen=True)
class SweepPlan:
    """Everything a sweep will compute; of a search, what is known of it yet."""

    sweep: Sweep
    preset: Presets | None
    cells: tuple[CellPlan, ...]
    identity: Any = None
    """What the id is made of; None: the cells."""
    search: SearchRecord | None = None
    """Of a search: what is known of it yet."""
    given_up: frozenset[str] = frozenset()
    """Stages that failed before the plan grew, and are not tried again in this call."""
    grow: Callable[[Collection[str]], SweepPlan | None] = lambda failed: None
    """The next plan of a search once the targets are done, but for the `failed`; None: finished."""

    @property
    def id(self) -> str:
        """Name and a hash of what it computes: the same sweep has the same id on any machine."""
        identity = self.identity or [plan.identity for plan in self.cells]
        return f"{self.sweep.name}-{json_digest(identity)[:10]}"

    @property
    def targets(self) -> list[Stage]:
        """The stages that nothing else in the sweep uses, less those that are given up."""
        return [stage for stage in self._last if stage.address not in self.given_up]

    @property
    def _last(self) -> list[Stage]:
        return [stage for plan in self.cells for stage in plan.stages.last]

    @property
    def config(self) -> Config:
        """Settings of the first cell: what all cells share, and resources."""
        return self.cells[0].config

    def folder(self, ledger: Ledger) -> Path:
        """Where the sweep's own files lie: the plan, tables."""
        return ledger.store / "sweeps" / self.id

    def write(self, ledger: Ledger) -> Path:
        """Write the record of the sweep into its folder, from which tables are made later."""
        folder = self.folder(ledger)
        self.record().save(folder)
        return folder

    def record(self) -> SweepRecord:
        """What the store keeps of the plan."""
        return SweepRecord(
            id=self.id,
            name=self.sweep.name,
            title=self.sweep.title,
            file=str(self.sweep.path),
            preset=preset_title(self.preset),
            baseline=self.sweep.baseline,
            show=tuple(self.sweep.show),
            over=tuple(self.sweep.over),
            cells=tuple(_cell_record(plan) for plan in self.cells),
            stages={stage.address: stage.name for stage in closure(self._last)},
            search=self.search,
        )


def plan_cell(
    sweep: Sweep,
    cell: Cell,
    seed: int,
    builder: GraphBuilder,
    preset: Presets | None,
    overrides: Sequence[str],
) -> CellPlan:
    """Resolve one cell at one seed."""
    config = cell_config(sweep, cell, seed, preset, overrides)
    stages = builder.cell(config, cell.model, cell.name, cell.weights, cell.method or None)
    if cell.objective:
        stages = replace(stages, evaluations=())
    return CellPlan(cell, seed, config, stages)


def _cell_record(plan: CellPlan) -> CellRecord:
    return CellRecord(
        name=plan.cell.name,
        label=plan.cell.label,
        kind=plan.cell.model,
        seed=plan.seed,
        trials=plan.trials,
        model=plan.stages.model.address if plan.stages.model else None,
        pretrain=_pretraining(plan.stages.model),
        evaluations=tuple(stage.address for stage in plan.stages.evaluations),
        config=_masked(plain(plan.config)),
        grasps_per_scene=plan.config.execution.grasps_per_scene,
        paper=dict(plan.cell.paper),
        objective=dict(plan.cell.objective),
        data=_data(plan),
    )


def _masked(value: Any) -> Any:
    """The settings as they may be kept: without passwords in URIs."""
    if isinstance(value, dict):
        return {name: _masked(item) for name, item in value.items()}
    return masked(value) if isinstance(value, str) else value


def _data(plan: CellPlan) -> tuple[DataRecord, ...]:
    """The scene sets that a cell learns from and is tested on, by their stages."""
    shards: dict[str, list[str]] = {"training": [], "testing": []}
    for stage in (plan.stages.model, *plan.stages.evaluations):
        scenes = stage.inputs.get("scenes", ()) if stage else ()
        context = "training" if stage is plan.stages.model else "testing"
        for shard in scenes if isinstance(scenes, tuple) else (scenes,):
            shards[context].append(shard.address)
    kinds = {"training": plan.config.scenes.train.kind, "testing": plan.config.scenes.test.kind}
    return tuple(
        DataRecord(context, f"{kinds[context]} scenes", tuple(addresses))
        for context, addresses in shards.items()
        if addresses
    )


def _pretraining(model: Stage | None) -> str | None:
    """The stage whose weights a fine-tuned model starts from."""
    weights = model.inputs.get("weights") if model else None
    return weights.address if isinstance(weights, Stage) else None
