"""Experiments from Python, on real stages at smoke size and on stages without science."""

from __future__ import annotations

import doctest
import json
import re
import subprocess
import sys
from pathlib import Path

import pandas as pd
import pytest

import dmfc as package
from dmfc.errors import DmfcError
from dmfc.experiment import api
from dmfc.pipeline.kinds import KINDS
from tests.support.fake_science import FAKES

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture
def lab(tmp_path, monkeypatch):
    """An experiment whose stages need no science."""
    for name, fake in FAKES.items():
        monkeypatch.setitem(KINDS, name, fake)
    return package.Experiment("smoke", store=tmp_path / "store")


def test_settings_go_over_the_preset(tmp_path):
    settings = {"training.seed": 3, "objects.train": ["procedural:2"], "hand.name": "shadow"}
    lab = package.Experiment("smoke", settings, tmp_path)
    assert (lab.config.training.seed, lab.config.objects.train) == (3, ["procedural:2"])
    assert lab.config.scenes.train.count == 8  # of the preset
    with pytest.raises(DmfcError, match=r"training\.seed"):
        package.Experiment("smoke", {"training.sed": 3}, tmp_path)


def test_python_and_the_command_answer_the_same(lab, dmfc, tmp_path):
    found = lab.evaluate("planner", scenes="multi:5")
    options = ("--scenes", "multi:5", "--preset", "smoke", "--store", lab.store, "--json")
    status, out, _ = dmfc("evaluate", "planner", *options)
    assert status == 0
    assert json.loads(out) == json.loads(json.dumps(found.summary))
    assert len(found.trials) == found.row.trials == 20
    assert found.overall == found.trials["held"].mean()
    found.write(tmp_path / "out")
    pd.testing.assert_frame_equal(pd.read_parquet(tmp_path / "out/trials.parquet"), found.trials)


def test_a_trained_model_is_evaluated(lab):
    model = lab.train("pretrain")
    assert list(model.metrics["epoch"]) == [0, 1]
    assert model.folder.name == model.address.partition("/")[2]
    assert len(lab.evaluate("pretrained").trials) == len(lab.evaluate("planner").trials)
    with pytest.raises(DmfcError, match="pretrain"):
        lab.train("pretrian")


def test_a_sweep_gives_its_table_and_trials(lab):
    result = lab.sweep("table1")
    assert result.complete
    assert list(result.rates.index) == [row.name for row in result.table.rows]
    planner = result.trials[result.trials["cell"] == "planner"]
    assert result.rates.loc["planner", "overall"] == planner["held"].mean()
    assert [again.table for again in lab.tables(["table1"])] == [result.table]


def test_evaluations_are_compared_in_pairs(lab):
    found = lab.evaluate("planner")
    comparison = lab.compare(found, found)
    assert (comparison.difference, comparison.trials) == (0.0, len(found.trials))


def test_ctrl_c_is_a_keyboard_interrupt(lab, monkeypatch):
    """The program of somebody who uses the API does not end."""

    def interrupted(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr("dmfc.engine.engine.run_stages", interrupted)
    with pytest.raises(KeyboardInterrupt):
        lab.train("pretrain")


def test_importing_the_package_loads_no_library():
    code = "import sys; before = set(sys.modules); import dmfc; print(*set(sys.modules) - before)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    loaded = {name.partition(".")[0] for name in done.stdout.split()}
    assert loaded <= {"dmfc", "__future__"} | set(sys.stdlib_module_names)


@pytest.mark.full
def test_the_readme_trains_evaluates_and_tabulates(tmp_path, monkeypatch, capsys):
    """The real thing: MuJoCo, Lightning and Ray at smoke size."""
    (code,) = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(), re.DOTALL)
    monkeypatch.chdir(tmp_path)
    names: dict = {}
    exec(code, names)
    assert set(names["table"].rates.index) >= {"pretrained", "all", "planner", "random"}
    assert names["table"].complete
    assert len(names["trained"].trials) == len(names["ceiling"].trials) == 8
    assert "overall_low" in capsys.readouterr().out


@pytest.mark.full
def test_the_docstring_runs(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    runner = doctest.DocTestRunner()
    for test in doctest.DocTestFinder(recurse=False).find(api.Experiment, "Experiment"):
        runner.run(test)
    found = runner.summarize()
    assert (found.failed, found.attempted) == (0, 5)
