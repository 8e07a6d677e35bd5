"""`sweep.json`: what is written is read back, older files too, and all else is one line."""

from __future__ import annotations

import json

import pytest

from dmfc.errors import DmfcError
from dmfc.files.sealed import write_sealed
from dmfc.pipeline.graph import GraphBuilder
from dmfc.sweep.planner import plan_sweep
from dmfc.sweep.record import SearchRecord, SweepRecord
from dmfc.sweep.sweep_file import load_sweep
from tests.support.fake_science import FAKES, fake_refs

TEXT = """
name: tiny
title: A tiny sweep
seeds: [0, 1]
cells:
  pretrained: {model: pretrained, paper: {overall: [0.7, 0.02]}}
  all: {model: finetuned}
"""
OLD = {
    "version": 1,
    "id": "tiny-0123456789",
    "name": "tiny",
    "title": "A tiny sweep",
    "file": "tiny.yaml",
    "preset": None,
    "baseline": "all",
    "show": ["overall"],
    "cells": [
        {
            "name": "all",
            "label": "all terms",
            "kind": "finetuned",
            "seed": 3,
            "trials": 8,
            "model": "finetune/b",
            "pretrain": "pretrain/a",
            "evaluations": ["evaluate/c", "evaluate/d"],
            "config": {"training": {"seed": 3}},
        },
        {
            "name": "random",
            "label": "random",
            "kind": "random",
            "seed": 3,
            "trials": 8,
            "model": None,
            "pretrain": None,
            "evaluations": ["evaluate/e"],
            "config": {},
        },
    ],
    "stages": {"finetune/b": "all seed 3"},
}
"""What a store may hold that was written before cells named their data and objectives."""


@pytest.fixture
def plan(tmp_path):
    path = tmp_path / "tiny.yaml"
    path.write_text(TEXT)
    return plan_sweep(load_sweep(str(path)), GraphBuilder(fake_refs, FAKES), "smoke")


def test_what_is_written_is_read_back(plan, ledger):
    folder = plan.write(ledger)
    record = SweepRecord.load(folder)
    assert record == plan.record()
    assert record.id == plan.id
    assert [(cell.name, cell.seed) for cell in record.cells][:2] == [("pretrained", 0), ("all", 0)]
    assert record.cells[0].paper == {"overall": (0.7, 0.02)}
    assert set(record.targets) == {
        stage.address
        for cell in plan.cells
        for stage in (cell.stages.model, *cell.stages.evaluations, *_weights(cell))
        if stage
    }
    assert "search" not in json.loads((folder / "sweep.json").read_text())


def _weights(cell):
    model = cell.stages.model
    return [model.inputs["weights"]] if model and "weights" in model.inputs else []


def test_a_search_is_read_back(plan, tmp_path):
    search = SearchRecord({"coverage": 1.0}, {"a": [1, 2]}, 3, ({"a": 1}, {"a": 2}), 1)
    values = {**plan.record().to_json(), "search": json.loads(json.dumps(search.__dict__))}
    write_sealed(tmp_path / "sweep.json", values["version"], values)
    assert SweepRecord.load(tmp_path).search == search


def test_an_older_file_is_read(tmp_path):
    (tmp_path / "sweep.json").write_text(json.dumps(OLD))
    record = SweepRecord.load(tmp_path)
    trained, random = record.cells
    assert trained.stages == ("pretrain/a", "finetune/b", "evaluate/c", "evaluate/d")
    assert trained.run == "all-seed3"
    assert random.stages == ("evaluate/e",)
    assert (trained.data, trained.objective, record.search) == ((), {}, None)


@pytest.mark.parametrize(
    ("change", "part"),
    [
        (lambda values: values.update(version=0), "version 0, not 2"),
        (lambda values: values.update(version=2), "it has no digest"),
        (lambda values: values.pop("cells"), "cells"),
        (lambda values: values["cells"][0].pop("evaluations"), "evaluations"),
        (lambda values: values["cells"][0].update(row="planner"), "row"),
        (lambda values: values.update(cells=[3]), "int"),
        (lambda values: values["cells"][0].update(paper={"overall": 0.7}), "float"),
    ],
)
def test_a_file_of_another_dmfc_is_one_line(tmp_path, change, part):
    values = json.loads(json.dumps(OLD))
    change(values)
    (tmp_path / "sweep.json").write_text(json.dumps(values))
    with pytest.raises(DmfcError, match="run the same `dmfc sweep` again") as caught:
        SweepRecord.load(tmp_path)
    assert part in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("text", ["", "{", "[]", "null"])
def test_a_damaged_file_is_one_line(tmp_path, text):
    (tmp_path / "sweep.json").write_text(text)
    with pytest.raises(
        DmfcError, match=r"sweep\.json' is (damaged|no record of a sweep).*run the same"
    ):
        SweepRecord.load(tmp_path)
