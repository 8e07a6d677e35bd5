"""`dmfc scenes`: make, look at, take along, freeze, mend, import."""

from __future__ import annotations

import json
import sys

import numpy as np
import pytest
from matplotlib.image import imread

from dmfc.assets.packs import get_pack
from dmfc.cli import main as cli
from dmfc.engine.ledger import Ledger
from dmfc.engine.pools import LocalPool
from dmfc.pipeline import selection
from dmfc.pipeline.kinds import KINDS
from dmfc.scenes.publish.published import PublishedSet
from tests.support.shape_stages import SHAPES, shape_refs

SETTINGS = ("--preset", "smoke", "--set", "scenes.train.kind=multi", "--set", "scenes.test.count=3")


@pytest.fixture
def dmfc(capsys, monkeypatch):
    """Runs `dmfc ...` on the test shapes in this process: (status, standard output, error)."""
    for name, kind in SHAPES.items():
        monkeypatch.setitem(KINDS, name, kind)
    monkeypatch.setattr(selection, "list_refs", shape_refs)
    monkeypatch.setattr("dmfc.engine.engine.RayPool", LocalPool)

    def call(*arguments: object) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["dmfc", *map(str, arguments)])
        with pytest.raises(SystemExit) as ended:
            cli.main()
        status = ended.value.code
        return (status if isinstance(status, int) else 0), *capsys.readouterr()

    return call


def test_a_set_from_making_to_elsewhere(dmfc, tmp_path):
    store, away = tmp_path / "store", tmp_path / "away"
    options = (*SETTINGS, "--store", store, "--json")
    status, _, err = dmfc("scenes", "stats", *options)
    assert status == 1
    assert "2 of 2 shards of the train set are not made yet" in err
    status, out, err = dmfc("scenes", "make", *options)
    assert status == 0, err
    made = json.loads(out)
    assert made["scenes"] == 8
    assert made["grasps"] + sum(made["dropped"].values()) == 80 * 8 * made["objects_per_scene"]
    assert made["matching"]["patch"]["positive_seeds"] > 0
    assert json.loads(dmfc("scenes", "stats", *options)[1]) == made

    status, out, _ = dmfc("scenes", "make", *options, "--out", away)
    assert {path.name for path in away.iterdir()} == {
        *("manifest.json", "README.md", "sheet.png", "shards", "grasps")
    }
    card = (away / "README.md").read_text()
    candidates = 80 * 8 * made["objects_per_scene"]
    share = 100 * made["grasps"] / candidates
    assert f"| labels | {made['grasps']} ({share:.1f} %) |" in card
    assert f"| grasps of the objects, scene by scene | {candidates:.0f} |" in card
    seeds = 100 * made["matching"]["patch"]["positive_seeds"]
    assert next(row for row in card.splitlines() if "**patch**" in row).split(" | ")[3] == (
        f"{seeds:.1f} %"
    )
    packs = json.loads((away / "manifest.json").read_text())["packs"]
    assert packs == {"shadow_hand": get_pack("shadow_hand").sha256}
    assert "| set.kind | multi |" in card
    assert imread(away / "sheet.png").std() > 0.05

    (store / "stages").rename(tmp_path / "gone")  # what is published needs no store
    status, out, _ = dmfc("scenes", "stats", "--at", away, *options)
    assert {**json.loads(out), "place": ""} == {**made, "place": ""}
    assert dmfc("scenes", "stats", "--at", away, "--verify", *options)[0] == 0
    picture = tmp_path / "scene.png"
    status, out, err = dmfc("scenes", "show", 3, "--at", away, "-o", picture, *options)
    assert status == 0, err
    assert json.loads(out)[0]["labels"] == len(PublishedSet.open(str(away)).scenes[3].grasp_index)
    assert imread(picture).std() > 0.05
    status, _, err = dmfc("scenes", "show", 8, "--at", away, *options)
    assert (status, err) == (1, "error: there is no scene 8: the set holds 8\n")
    shard = away / "shards" / "00001.parquet"
    shard.write_bytes(shard.read_bytes()[:-9])
    status, _, err = dmfc("scenes", "stats", "--at", away, "--verify", *options)
    assert status == 1
    assert "1 files" in err
    assert "shards/00001.parquet" in err
    assert f"--out {away}` makes them again" in err


def test_a_truncated_shard_is_mended_by_making_again(dmfc, tmp_path):
    options = (*SETTINGS, "--store", tmp_path, "--json")
    before = json.loads(dmfc("scenes", "make", *options)[1])
    ledger = Ledger(tmp_path)
    path = ledger.folder(next(ledger.addresses("scenes"))) / "scenes.parquet"
    whole = path.read_bytes()
    path.write_bytes(whole[:5000])
    status, _, err = dmfc("scenes", "show", 0, "-o", tmp_path / "x.png", *options)
    status, out, err = dmfc("scenes", "make", *options)
    assert status == 0
    assert "is damaged (scenes.parquet has changed): it is made again" in err
    assert json.loads(out) == before
    assert path.read_bytes() == whole


def test_frozen_test_sets(dmfc, tmp_path):
    options, record = ("--store", tmp_path / "store", "--json"), tmp_path / "test_sets.json"
    status, out, err = dmfc("scenes", "freeze", record, *SETTINGS, *options)
    assert status == 0, err
    known = json.loads(record.read_text())
    assert set(known["sets"]) == {"single_standard", "single", "multi"}
    assert all(len(part.split()) == 3 for one in known["sets"].values() for part in one.values())
    status, out, _ = dmfc("scenes", "freeze", record, "--check", *options)
    assert status == 0
    assert {row["clouds that differ"] for row in json.loads(out)} == {0}
    words = known["sets"]["multi"]["clouds"].split()
    known["sets"]["multi"]["clouds"] = " ".join([words[0], "00000000", words[2]])
    record.write_text(json.dumps(known))
    status, out, _ = dmfc("scenes", "freeze", record, "--check", *options)
    assert status == 1
    assert [row["clouds that differ"] for row in json.loads(out)] == [0, 0, 1]
    status, _, err = dmfc("scenes", "freeze", tmp_path / "none.json", "--check", *options)
    assert status == 1
    assert err.startswith("error: there is no file")


def test_own_clouds_are_a_set_like_any_other(dmfc, tmp_path):
    cloud = np.random.default_rng(0).uniform([-0.05, -0.05, -0.01], [0.05, 0.05, 0.1], (5000, 3))
    np.save(tmp_path / "mine.npy", cloud * 1000)
    own = tmp_path / "own"
    arguments = ("scenes", "import", tmp_path / "mine.npy", "-o", own, "--unit", "mm")
    status, out, err = dmfc(*arguments, "--above", 0.0, "--json")
    assert status == 0, err
    assert (json.loads(out)["scenes"], json.loads(out)["grasps"]) == (1, 0)
    (scene,) = PublishedSet.open(str(own)).scenes
    assert scene.points.shape == (2048, 3)
    assert 0 <= scene.points[:, 2].min() < 0.01
    assert "none, no labels" in (own / "README.md").read_text()
    status, _, err = dmfc("scenes", "show", 0, "--at", own, "-o", tmp_path / "own.png")
    assert status == 0, err
    status, _, err = dmfc("scenes", "import", tmp_path / "no.npy", "-o", own)
    assert status == 1
    assert "there is no file" in err
