"""The one place that knows the names of a stage's files, and how they are read."""

from __future__ import annotations

import ast
import json
from pathlib import Path

import pandas as pd
import pytest

import dmfc
from dmfc.errors import DmfcError
from dmfc.pipeline import artifacts

NAMES = [
    getattr(artifacts, name)
    for name in (
        *("HAND", "OBJECT", "GRASPS", "SCENES", "SCENE_COUNTS"),
        *("WEIGHTS", "METRICS", "TRIALS", "DIVERSITY"),
    )
]


@pytest.mark.parametrize("name", NAMES)
def test_the_name_of_a_file_is_written_once(name):
    holders = [
        path.name
        for path in Path(dmfc.__file__).parent.rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.Constant) and node.value == name
    ]
    assert len(holders) == 1, holders


def test_rows_are_read_back(tmp_path):
    rows = pd.DataFrame({"scene": [0, 1], "held": [True, False]})
    rows.to_parquet(tmp_path / "trials.parquet")
    pd.testing.assert_frame_equal(artifacts.load_trials(tmp_path), rows)
    assert list(artifacts.load_trials(tmp_path, ["held"])) == ["held"]
    lines = [{"epoch": 0, "split": "train"}, {"epoch": 0, "split": "val"}]
    (tmp_path / "metrics.jsonl").write_text("".join(json.dumps(line) + "\n" for line in lines))
    assert artifacts.load_metrics(tmp_path) == lines


@pytest.mark.parametrize(
    ("load", "name"),
    [
        (artifacts.load_trials, "trials.parquet"),
        (artifacts.load_diversity, "diversity.parquet"),
        (artifacts.load_metrics, "metrics.jsonl"),
        (artifacts.load_hand, "hand.npz"),
        (artifacts.load_object, "object.npz"),
        (artifacts.load_grasps, "grasps.parquet"),
        (lambda folder: artifacts.load_scenes([folder]), "scenes.parquet"),
    ],
)
@pytest.mark.parametrize("content", [None, b"", b"not what it says\n"])
def test_a_file_that_is_missing_or_damaged_is_named_on_one_line(tmp_path, load, name, content):
    if content is not None:
        (tmp_path / name).write_bytes(content)
    if name == "metrics.jsonl" and content == b"":
        assert load(tmp_path) == []  # a model without an epoch
        return
    with pytest.raises(DmfcError) as caught:
        load(tmp_path)
    assert name in str(caught.value)
    assert "\n" not in str(caught.value)


def test_objects_are_loaded_when_they_are_asked_for(tmp_path):
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        record = {"config": {"object": f"shape/{name}"}}
        (tmp_path / name / "stage.json").write_text(json.dumps(record))
    objects = artifacts.Objects([tmp_path / "a", tmp_path / "b"])
    assert list(objects) == ["shape/a", "shape/b"]
    assert len(objects) == 2
    with pytest.raises(DmfcError, match=r"object\.npz"):
        objects["shape/a"]
