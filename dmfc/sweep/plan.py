"""A sweep file and a preset, resolved into the stages of every cell."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dmfc.config.schema import Config
from dmfc.sweep.context import write_json
from dmfc.sweep.graph import CellStages, GraphBuilder
from dmfc.sweep.ledger import Ledger
from dmfc.sweep.stage import Stage, plain
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
        """K x scenes: the denominator of its rates, whatever becomes of its stages."""
        return self.config.execution.grasps_per_scene * self.config.scenes.test.count


@dataclass(frozen=True)
class SweepPlan:
    """Everything a sweep will compute."""

    sweep: Sweep
    preset: str | None
    cells: tuple[CellPlan, ...]

    @property
    def id(self) -> str:
        """Name and a hash of what it computes: the same sweep has the same id on any machine."""
        text = json.dumps([_cell_identity(plan) for plan in self.cells], sort_keys=True)
        return f"{self.sweep.name}-{hashlib.sha256(text.encode()).hexdigest()[:10]}"

    @property
    def targets(self) -> list[Stage]:
        """The stages that nothing else in the sweep uses."""
        return [stage for plan in self.cells for stage in plan.stages.evaluations]

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
            "cells": [_describe_cell(plan) for plan in self.cells],
        }


def plan_sweep(
    sweep: Sweep, builder: GraphBuilder, preset: str | None, overrides: Sequence[str] = ()
) -> SweepPlan:
    """Resolve every cell at every seed. Raises DmfcError on the first setting that is wrong."""

    def plans() -> Iterator[CellPlan]:
        for seed in sweep.seeds:
            for cell in sweep.cells:
                config = cell_config(sweep, cell, seed, preset, overrides)
                yield CellPlan(cell, seed, config, builder.cell(config, cell.model, cell.name))

    return SweepPlan(sweep, preset, tuple(plans()))


def _cell_identity(plan: CellPlan) -> list[Any]:
    return [plan.cell.name, plan.seed, [stage.key for stage in plan.stages.evaluations]]


def _describe_cell(plan: CellPlan) -> dict[str, Any]:
    return {
        "name": plan.cell.name,
        "label": plan.cell.label,
        "kind": plan.cell.model,
        "paper": {name: list(pair) for name, pair in plan.cell.paper.items()},
        "seed": plan.seed,
        "trials": plan.trials,
        "grasps_per_scene": plan.config.execution.grasps_per_scene,
        "model": plan.stages.model.address if plan.stages.model else None,
        "pretrain": _pretraining(plan.stages.model),
        "evaluations": [stage.address for stage in plan.stages.evaluations],
        "config": plain(plan.config),
    }


def _pretraining(model: Stage | None) -> str | None:
    """The stage whose weights a fine-tuned model starts from."""
    weights = model.inputs.get("weights") if model else None
    return weights.address if isinstance(weights, Stage) else None
