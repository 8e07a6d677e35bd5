"""Rates over a setting: which cells are one line of the figure."""

from __future__ import annotations

import pandas as pd
import pytest

from dmfc.errors import DmfcError
from dmfc.report.over import draw_over, lines_over
from dmfc.report.table import CellRows, make_table
from dmfc.sweep.sweep_file import load_sweep
from tests.support.alone import planned

NOISE = "scenes.test.sensor.noise"
SWEEP = f"""
table: {{over: [{NOISE}, scenes.test.sensor.mask]}}
cells:
  plain: {{model: pretrained}}
  noisy: {{model: pretrained, set: {{{NOISE}: 0.004}}}}
  check: {{model: pretrained, set: {{execution.cloud_check: true}}}}
  check-noisy: {{model: pretrained, set: {{execution.cloud_check: true, {NOISE}: 0.002}}}}
  wide: {{model: pretrained, set: {{scenes.test.sensor.mask: 3}}}}
  both: {{model: pretrained, set: {{scenes.test.sensor.mask: 5, {NOISE}: 0.01}}}}
"""


def rows(held):
    return pd.DataFrame(
        [
            {"scene": k, "trial": 0, "object": "a", "planned": True, "held": k < held, "reason": ""}
            for k in range(8)
        ]
    )


def test_a_line_has_the_cells_that_differ_in_nothing_else(tmp_path):
    plan = planned(tmp_path / "noise.yaml", SWEEP)
    names = [cell.cell.name for cell in plan.cells]
    cells = [CellRows(name, name, 0, 8, rows(k)) for k, name in enumerate(names)]
    table = make_table(cells, id="x", name="x", title="x", preset="smoke")
    record = type(plan.record()).of_json(plan.record().to_json())
    found = {
        line.label: [(value, row.name) for value, row in line.points]
        for line in lines_over(table, record, NOISE)
    }
    assert found == {
        "plain": [(0.0, "plain"), (0.004, "noisy")],
        "check": [(0.0, "check"), (0.002, "check-noisy")],
    }
    (masks,) = lines_over(table, record, "scenes.test.sensor.mask")
    assert [(value, row.name) for value, row in masks.points] == [(0.0, "plain"), (3.0, "wide")]
    assert draw_over(table, record, tmp_path / "over.png")
    assert (tmp_path / "over.png").read_bytes().startswith(b"\x89PNG")


def test_only_numbers_can_be_drawn_over(tmp_path):
    path = tmp_path / "noise.yaml"
    path.write_text("table: {over: [scenes.test.sensor.nois]}\ncells: {a: {}}\n")
    with pytest.raises(DmfcError, match=r"did you mean 'scenes\.test\.sensor\.noise'"):
        load_sweep(str(path))


def test_the_shipped_sweep_varies_one_kind_at_a_time():
    sweep = load_sweep("robustness")
    assert set(sweep.over) >= {NOISE}
    assert all(len(cell.settings) <= 1 for cell in sweep.cells)
