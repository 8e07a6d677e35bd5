"""A whole sweep without science, Ray or MLflow, driven in this process."""

from __future__ import annotations

from pathlib import Path

import pandas as pd
import pytest

from dmfc.engine.engine import run_stages
from dmfc.engine.ledger import Ledger
from dmfc.engine.pools import LocalPool
from dmfc.experiment.drive import Driven, drive
from dmfc.files.sealed import DamagedError
from dmfc.pipeline import kinds
from dmfc.pipeline.graph import GraphBuilder
from dmfc.report.collect import collect
from dmfc.report.rates import concatenate
from dmfc.sweep.plan import SweepPlan
from dmfc.sweep.planner import plan_sweep
from dmfc.sweep.sweep_file import load_sweep
from tests.support.fake_science import FAKES, fake_refs


def patch_science(patch: pytest.MonkeyPatch) -> None:
    """Let `drive` run stages without science one after the other here, and leave MLflow out."""
    patch.setattr("dmfc.engine.engine.RayPool", LocalPool)
    patch.setattr("dmfc.engine.engine.git_commit", lambda: "0123")
    patch.setattr("dmfc.experiment.drive._track", lambda plan, ledger: {})
    for name, fake in FAKES.items():
        patch.setitem(kinds.KINDS, name, fake)  # type: ignore[arg-type]


def planned(path: Path, text: str) -> SweepPlan:
    """The plan of a sweep file with this text."""
    path.write_text(text)
    return plan_sweep(load_sweep(str(path)), GraphBuilder(fake_refs, FAKES), "smoke")


def driven(plan: SweepPlan, store: Path) -> Driven:
    """What `dmfc sweep` does; raises what it would print."""
    return drive([plan], Ledger(store), as_json=True)


def made(plan: SweepPlan, store: Path) -> list[str]:
    """Make the stages of a sweep; why some are not there, as every reader of rows is told."""
    ledger = Ledger(store)
    outcomes = run_stages(plan.targets, ledger, plan.config, kinds=FAKES, local=True)
    told = [found.reason for found in outcomes.values() if not (found.ok or found.kept)]
    try:
        trial_rows(plan, store)
    except DamagedError as error:
        told.append(str(error))
    return told


def trial_rows(plan: SweepPlan, store: Path) -> pd.DataFrame:
    """The trial rows of the sweep as any reader gets them."""
    cells = collect(Ledger(store), plan.record())
    return concatenate([cell.rows.assign(cell=cell.name, seed=cell.seed) for cell in cells])
