"""docs/extend.md does what it says: its files, and its commands on them."""

from __future__ import annotations

import pandas as pd
import pytest
import torch

from dmfc.config.hand import HandConfig
from dmfc.config.losses import LossConfig
from dmfc.hand.build import build_hand
from dmfc.losses.task import SceneTerms
from dmfc.objects.atlas import ObjectAtlas, SceneObjects
from dmfc.objects.sources import list_objects
from dmfc.sweep.sweep_file import cell_config, load_sweep
from tests.support.pages import run, write_files
from tests.support.toy import toy_atlas

PAGE = "extend.md"


@pytest.fixture
def folder(tmp_path, monkeypatch):
    write_files(PAGE, tmp_path)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_the_objects_are_bars_of_the_sizes_that_they_are_named_by(folder):
    found = list_objects(["my_objects.py:bars"])
    assert [(item.id, item.mass) for item in found] == [
        ("own/bar-25mm", 0.1),
        ("own/bar-35mm", 0.1),
    ]
    for item, radius in zip(found, (0.025, 0.035), strict=True):
        # A regular hexagon of circumradius r has the area 3 sqrt(3) / 2 r^2.
        assert item.load().volume == pytest.approx(0.12 * 2.598076 * radius**2, rel=1e-5)


def test_the_loss_is_the_squared_depth_below_one_centimetre(folder):
    """Of the page's hand, palm up: its lowest point is the bottom of the palm, 1 cm below."""
    hand = build_hand(HandConfig(name="claw.yaml", collision_points=400, link_sdf_spacing=0.004))
    terms = SceneTerms(hand, LossConfig(custom={"my_losses.py:off_table": 1.0}))
    atlas: ObjectAtlas = toy_atlas()
    height = torch.tensor([0.03, 0.015, 0.01, 0.0]).double()
    n = len(height)
    position = torch.stack([torch.zeros(n), torch.zeros(n), height], dim=1).double()
    objects = SceneObjects(
        atlas, torch.zeros(n, 1, dtype=torch.long), torch.eye(4).double().expand(n, 1, 4, 4)
    )
    joints = torch.from_numpy(hand.open_joints).expand(n, -1)
    rotation = torch.eye(3).double().expand(n, 3, 3)
    value = terms(position, rotation, joints, objects, ["custom_off_table"])["custom_off_table"]
    assert value.tolist() == pytest.approx([0, 0.25, 1, 4], abs=1e-6)


def test_the_sweep_names_all_of_it(folder):
    sweep = load_sweep("my_sweep.yaml")
    assert [cell.name for cell in sweep.cells] == ["four", "five", "nearest", "planner", "random"]
    four, five = (cell_config(sweep, cell, 0, "smoke", []) for cell in sweep.cells[:2])
    assert four.hand.name == "claw.yaml"
    assert four.losses.custom == {}
    assert four.network.backbone == "pointnet2"
    assert five.losses.custom == {"my_losses.py:off_table": 1.0}
    assert five.losses.weights == four.losses.weights


@pytest.mark.full
def test_the_commands_run_as_printed(folder):
    told = run(PAGE, folder)
    assert "own/bar-25mm" in told
    assert "and off the table" in told
    (rows,) = (folder / "store" / "sweeps").glob("own-*/trials.parquet")
    trials = pd.read_parquet(rows)
    assert set(trials["cell"]) == {"four", "five", "nearest", "planner", "random"}
    assert set(trials["object"]) - {""} == {"procedural/box-0000"}  # "": no candidate there
    metrics = [
        path.read_text() for path in (folder / "store").glob("stages/finetune/*/metrics.jsonl")
    ]
    assert sorted("custom_off_table" in text for text in metrics) == [False, True]
    kept, planned = (
        {path.name: len(pd.read_parquet(path)) for path in (folder / name).rglob("*.parquet")}
        for name in ("my_grasps", "planned")
    )
    assert len(planned) == 3
    assert all(0 < kept[name] < planned[name] for name in planned)
