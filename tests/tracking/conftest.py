"""A finished sweep without science, run in this process."""

import shutil
from pathlib import Path

import pytest

from dmfc.engine.engine import run_stages
from dmfc.engine.ledger import Ledger
from dmfc.engine.provenance import add_provenance
from dmfc.engine.state import write_state
from dmfc.pipeline.graph import GraphBuilder
from dmfc.report.collect import collect, table_of, write_table
from dmfc.sweep.planner import plan_sweep
from dmfc.sweep.sweep_file import load_sweep
from dmfc.tracking.store import database
from tests.support.fake_science import FAKES, fake_refs

SWEEP = """
name: tiny
title: A tiny sweep
cells:
  pretrained: {model: pretrained}
  all: {model: finetuned, set: {losses.weights.guidance: 2}}
  broken: {model: finetuned, set: {losses.weights.guidance: 13}}
"""


class FinishedSweep:
    """Runs the sweep again into the same store; holds what tracking is given."""

    def __init__(self, folder: Path, text: str = SWEEP) -> None:
        path = folder / "tiny.yaml"
        path.write_text(text)
        self.ledger = Ledger(folder / "store")
        plan = plan_sweep(load_sweep(str(path)), GraphBuilder(fake_refs, FAKES), "smoke")
        plan.write(self.ledger)
        outcomes = run_stages(plan.targets, self.ledger, plan.config, kinds=FAKES, local=True)
        failures = {a: outcome.reason for a, outcome in outcomes.items() if not outcome.ok}
        self.description = plan.record()
        self.id = plan.id
        self.folder = plan.folder(self.ledger)
        self.table = table_of(self.ledger, self.description, failures)
        write_state(self.folder, "FAILED" if failures else "FINISHED", failures)
        add_provenance(self.folder)
        self.cells = collect(self.ledger, self.description, failures)
        write_table(self.ledger, self.table, self.cells)


@pytest.fixture
def finished(tmp_path, empty_database):
    sweep = FinishedSweep(tmp_path)
    database(sweep.ledger).parent.mkdir()
    shutil.copy(empty_database, database(sweep.ledger))
    sweep.empty = empty_database
    return sweep
