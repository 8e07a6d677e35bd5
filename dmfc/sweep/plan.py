"""A sweep file and a preset, resolved into the stages of every cell."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from dmfc.config.schema import Config
from dmfc.engine.ledger import Ledger
from dmfc.engine.stage import Stage, closure, plain
from dmfc.errors import masked
from dmfc.files.atomic import write_json
from dmfc.pipeline.graph import CellStages, GraphBuilder
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
    preset: str | None
    cells: tuple[CellPlan, ...]
    identity: Any = None
    """What the id is made of; None: the cells."""
    search: Mapping[str, Any] = field(default_factory=dict)
    """Of a search: objective, space, trials wanted, the settings of each so far, the best one."""
    given_up: frozenset[str] = frozenset()
    """Stages that failed before the plan grew, and are not tried again in this call."""
    grow: Callable[[Collection[str]], SweepPlan | None] = lambda failed: None
    """The next plan of a search once the targets are done, but for the `failed`; None: finished."""

    @property
    def id(self) -> str:
        """Name and a hash of what it computes: the same sweep has the same id on any machine."""
        identity = self.identity or [plan.identity for plan in self.cells]
        text = json.dumps(identity, sort_keys=True)
        return f"{self.sweep.name}-{hashlib.sha256(text.encode()).hexdigest()[:10]}"

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
        """Write `sweep.json`, from which tables and tracking are made later."""
        folder = self.folder(ledger)
        folder.mkdir(parents=True, exist_ok=True)
        write_json(folder / "sweep.json", self.describe())
        return folder

    def describe(self) -> dict[str, Any]:
        """The plan as JSON."""
        return {
            "version": 1,
            "id": self.id,
            "name": self.sweep.name,
            "title": self.sweep.title,
            "file": str(self.sweep.path),
            "preset": self.preset,
            "baseline": self.sweep.baseline,
            "show": list(self.sweep.show),
            **({"search": dict(self.search)} if self.search else {}),
            "cells": [_describe_cell(plan) for plan in self.cells],
            "stages": {stage.address: stage.name for stage in closure(self._last)},
        }


def plan_sweep(
    sweep: Sweep,
    builder: GraphBuilder,
    preset: str | None,
    overrides: Sequence[str] = (),
    ledger: Ledger | None = None,
) -> SweepPlan:
    """Resolve every cell at every seed. Raises DmfcError on the first setting that is wrong.

    A search needs the `ledger` too: what it tries next depends on what it has found.
    """
    if sweep.search is not None:
        from dmfc.sweep.search_plan import SearchPlanner

        assert ledger is not None, "a search is planned with its ledger"
        return SearchPlanner(sweep, builder, preset, overrides, ledger).now()
    cells = [
        plan_cell(sweep, cell, seed, builder, preset, overrides)
        for seed in sweep.seeds
        for cell in sweep.cells
    ]
    return SweepPlan(sweep, preset, tuple(cells))


def plan_cell(
    sweep: Sweep,
    cell: Cell,
    seed: int,
    builder: GraphBuilder,
    preset: str | None,
    overrides: Sequence[str],
) -> CellPlan:
    """Resolve one cell at one seed."""
    config = cell_config(sweep, cell, seed, preset, overrides)
    stages = builder.cell(config, cell.model, cell.name)
    if cell.objective:
        stages = replace(stages, evaluations=())
    return CellPlan(cell, seed, config, stages)


def _describe_cell(plan: CellPlan) -> dict[str, Any]:
    return {
        "name": plan.cell.name,
        "label": plan.cell.label,
        "kind": plan.cell.model,
        "paper": {name: list(pair) for name, pair in plan.cell.paper.items()},
        "objective": dict(plan.cell.objective),
        "seed": plan.seed,
        "trials": plan.trials,
        "grasps_per_scene": plan.config.execution.grasps_per_scene,
        "model": plan.stages.model.address if plan.stages.model else None,
        "pretrain": _pretraining(plan.stages.model),
        "evaluations": [stage.address for stage in plan.stages.evaluations],
        "data": _data(plan),
        "config": _masked(plain(plan.config)),
    }


def _masked(value: Any) -> Any:
    """The settings as they may be kept: without passwords in URIs."""
    if isinstance(value, dict):
        return {name: _masked(item) for name, item in value.items()}
    return masked(value) if isinstance(value, str) else value


def _data(plan: CellPlan) -> list[dict[str, Any]]:
    """The scene sets that a cell learns from and is tested on, by their stages."""
    shards: dict[str, list[str]] = {"training": [], "testing": []}
    for stage in (plan.stages.model, *plan.stages.evaluations):
        scenes = stage.inputs.get("scenes", ()) if stage else ()
        context = "training" if stage is plan.stages.model else "testing"
        for shard in scenes if isinstance(scenes, tuple) else (scenes,):
            shards[context].append(shard.address)
    kinds = {"training": plan.config.scenes.train.kind, "testing": plan.config.scenes.test.kind}
    return [
        {"context": context, "name": f"{kinds[context]} scenes", "stages": addresses}
        for context, addresses in shards.items()
        if addresses
    ]


def _pretraining(model: Stage | None) -> str | None:
    """The stage whose weights a fine-tuned model starts from."""
    weights = model.inputs.get("weights") if model else None
    return weights.address if isinstance(weights, Stage) else None
