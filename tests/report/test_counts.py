"""Trials = K x scenes in every row of a table, also where a shard of the evaluation crashed."""

from __future__ import annotations

import dataclasses
from pathlib import Path

from dmfc.engine.engine import run_stages
from dmfc.engine.ledger import Ledger
from dmfc.pipeline.graph import GraphBuilder
from dmfc.report.collect import collect, read_sweep, table_of
from dmfc.sweep.planner import plan_sweep
from dmfc.sweep.sweep_file import load_sweep
from tests.support.fake_science import FAKES, fake_refs

CRASHING = FAKES | {
    "evaluate": dataclasses.replace(
        FAKES["evaluate"], entry="tests.support.dying_stages:fake_evaluate_or_crash"
    )
}
SCENES, K = 6, 4
SWEEP = f"""
base: {{scenes.test.count: {SCENES}, scenes.shard_size: 2, execution.grasps_per_scene: {K}}}
cells:
  pretrained: {{model: pretrained}}
"""


def test_a_crashed_shard_stays_in_the_denominator(tmp_path: Path) -> None:
    path, ledger = tmp_path / "counts.yaml", Ledger(tmp_path / "store")
    path.write_text(SWEEP)
    plan = plan_sweep(load_sweep(str(path)), GraphBuilder(fake_refs, CRASHING), "smoke")
    plan.write(ledger)
    run_stages(plan.targets, ledger, plan.config, kinds=CRASHING, local=True)
    sweep = read_sweep(ledger, plan.id)
    table = table_of(ledger, sweep)
    assert {row.name for row in table.rows} == {"pretrained", "planner", "random"}
    written = collect(ledger, sweep)
    for row, cell in zip(table.rows, written, strict=True):
        assert len(cell.rows) == (SCENES - 2) * K  # scenes 2 and 3 crashed
        assert row.trials == SCENES * K
        assert row.rates.valid.trials == row.rates.overall.trials == SCENES * K
        assert row.reasons["missing"] == 2 * K
        assert row.rates.overall.successes + sum(row.reasons.values()) == SCENES * K
        assert row.rates.overall.successes == cell.rows["held"].sum()
        assert "1 of 3 shards missing" in row.failure
