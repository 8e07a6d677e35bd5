"""A table outside a store is made again from its rows, byte for byte."""

from __future__ import annotations

import json
from pathlib import Path

import pandas as pd
import pytest

from dmfc.engine.engine import run_stages
from dmfc.engine.ledger import Ledger
from dmfc.errors import DmfcError
from dmfc.pipeline.graph import GraphBuilder
from dmfc.report.agreement import agreements
from dmfc.report.collect import collect, read_sweep, table_of, write_table
from dmfc.report.exported import export_table, read_table, write_formats
from dmfc.report.formats import to_json
from dmfc.report.markdown import texts
from dmfc.report.page import draw_figures
from dmfc.sweep.planner import plan_sweep
from dmfc.sweep.sweep_file import load_sweep
from tests.support.fake_science import FAKES, fake_refs

SWEEP = """
title: "Rows & their files"
base: {scenes.test.count: 5, scenes.shard_size: 5, execution.grasps_per_scene: 4}
seeds: [0, 1]
cells:
  pretrained: {model: pretrained, paper: {valid: [0.67, 0.02], overall: [0.29, 0.02]}}
  all: {label: "fine-tuned, all", model: finetuned, set: {losses.weights.guidance: 2}}
"""
FORMATS = ("csv", "html", "json", "md", "png", "tex")


@pytest.fixture(scope="module")
def stored(tmp_path_factory):
    """The ledger, the record and the table of a finished sweep."""
    folder = tmp_path_factory.mktemp("exported")
    path, ledger = folder / "rows.yaml", Ledger(folder / "store")
    path.write_text(SWEEP)
    plan = plan_sweep(load_sweep(str(path)), GraphBuilder(fake_refs, FAKES), "smoke")
    plan.write(ledger)
    run_stages(plan.targets, ledger, plan.config, kinds=FAKES, local=True)
    sweep = read_sweep(ledger, plan.id)
    table = table_of(ledger, sweep)
    write_table(ledger, table, collect(ledger, sweep))
    draw_figures(ledger, sweep, table)
    return ledger, sweep, table


def test_rows_and_json_give_every_format_again(stored, tmp_path: Path) -> None:
    ledger, sweep, table = stored
    place, *_ = export_table(ledger, sweep, table, tmp_path)
    first = {name: (tmp_path / f"rows.{name}").read_bytes() for name in FORMATS}
    made = ledger.store / "sweeps" / table.id
    for name in set(FORMATS) - {"html"}:
        assert first[name] == (made / f"table.{name}").read_bytes()
    for name in set(FORMATS) - {"json"}:
        (tmp_path / f"rows.{name}").unlink()
    again = read_table(place)
    assert again == table
    write_formats(place, again)
    assert {name: (tmp_path / f"rows.{name}").read_bytes() for name in FORMATS} == first
    page = first["html"].decode()
    assert "losses.weights.guidance 1.0 -&gt; 2.0" in page
    assert table.claim() in page


def test_files_of_before_there_were_seeds_and_orders_are_read(stored, tmp_path: Path) -> None:
    ledger, sweep, table = stored
    place, *_ = export_table(ledger, sweep, table, tmp_path)
    told = json.loads((tmp_path / "rows.json").read_text())
    for key in ("order", "show", "baseline", "claims"):
        del told[key]
    for cell in told["cells"].values():
        for key in ("by_seed", "paired", "seed_spread", "rates_new_objects"):
            del cell[key]
    (tmp_path / "rows.json").write_text(json.dumps(told))
    assert {row.name: row for row in read_table(place).rows} == {
        row.name: row for row in table.rows
    }


def test_what_is_no_table_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(DmfcError, match=r"a file NAME\.trials\.parquet"):
        read_table(tmp_path / "rows.csv")
    with pytest.raises(DmfcError, match="there is no file"):
        read_table(tmp_path / "rows.trials.parquet")


def test_a_table_agrees_with_itself_and_not_with_another(stored, tmp_path: Path) -> None:
    ledger, sweep, table = stored
    place, *_ = export_table(ledger, sweep, table, tmp_path)
    found = agreements(ledger, tmp_path)
    assert [one.cell for one in found] == [row.name for row in table.rows]
    assert all(one.agrees and one.line.endswith("the same in every trial") for one in found)
    rows = pd.read_parquet(place)
    rows.loc[rows["cell"] == "planner", ["planned", "held"]] = False
    rows.to_parquet(place)
    planner = next(row for row in table.rows if row.name == "planner").rates.overall
    worse = {one.cell: one for one in agreements(ledger, tmp_path, ["rows"])}["planner"]
    assert (worse.here, worse.reference) == (planner.value, 0)
    assert worse.different == planner.successes
    assert worse.agrees == (worse.low <= 0)
    rows[rows["scene"] < 4].to_parquet(place)
    fewer = agreements(ledger, tmp_path)
    assert not any(one.same_scenes for one in fewer)
    assert all("other scenes" in one.line for one in fewer)
    with pytest.raises(DmfcError, match="no table 'other'"):
        agreements(ledger, tmp_path, ["other"])


@pytest.mark.parametrize("name", ["quick/table1", "quick/table2", "table2"])
def test_what_results_has_is_made_of_its_rows(name: str) -> None:
    """Pictures and pages apart: those follow from the version of matplotlib, too."""
    place = Path(__file__).parents[2] / "results" / f"{name}.trials.parquet"
    table = read_table(place)
    for suffix, text in texts(table).items():
        assert place.with_name(f"{table.name}.{suffix}").read_text() == text
    assert json.loads(place.with_name(f"{table.name}.json").read_text()) == to_json(table)
