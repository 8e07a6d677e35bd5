"""Every table says which training objects it is made without, and why."""

import csv
import io

import pytest

from dmfc.engine.engine import run_stages
from dmfc.pipeline.graph import GraphBuilder
from dmfc.report.collect import read_sweep, table_of
from dmfc.report.formats import to_csv, to_json, to_latex
from dmfc.report.left_out import left_out_line
from dmfc.report.markdown import to_markdown
from dmfc.report.page import draw_figures, write_page
from dmfc.sweep.planner import plan_sweep
from dmfc.sweep.sweep_file import load_sweep
from tests.support.fake_science import FAKES, fake_refs

SWEEP = """
base:
  objects.train: [procedural/{name}, procedural/fine]
cells:
  pretrained: {{model: pretrained}}
"""
BROKEN = {f"procedural/broken/{i}": "the mesh has no volume" for i in range(2)}


@pytest.mark.parametrize(("name", "expected"), [("broken", BROKEN), ("good", {})])
def test_every_format_names_the_objects_that_were_left_out(tmp_path, ledger, name, expected):
    path = tmp_path / "left.yaml"
    path.write_text(SWEEP.format(name=name))
    plan = plan_sweep(load_sweep(str(path)), GraphBuilder(fake_refs, FAKES), "smoke")
    plan.write(ledger)
    run_stages(plan.targets, ledger, plan.config, kinds=FAKES, local=True)
    sweep = read_sweep(ledger, plan.id)
    table = table_of(ledger, sweep)
    assert not any(row.failure for row in table.rows)
    assert table.left_out == expected
    line = "Training objects left out: none."
    if expected:
        line = (
            "Training objects left out: 2: procedural/broken/0 (the mesh has no volume), "
            "procedural/broken/1 (the mesh has no volume)."
        )
    assert line in to_markdown(table).splitlines()
    assert f"% {line}" in to_latex(table).splitlines()
    assert to_json(table)["left_out"] == expected
    for row in csv.DictReader(io.StringIO(to_csv(table))):
        assert row["left_out"] == "; ".join(f"{k}: {v}" for k, v in expected.items())
    figures = draw_figures(ledger, sweep, table)
    page = write_page(ledger, sweep, table, figures)
    assert f'<p id="left-out">{line}</p>' in page.read_text()


def test_a_terminal_is_shown_a_few_of_many():
    line = left_out_line({f"o{i}": "bad" for i in range(5)}, most=3)
    assert line == "Training objects left out: 5: o0 (bad), o1 (bad), o2 (bad), and 2 more."
