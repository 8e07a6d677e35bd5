"""`dmfc grasps plan` and `stats`, `objects prepare`: failures are rows, a kill loses little."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from dmfc.cli import main as cli
from dmfc.engine.pools import LocalPool
from dmfc.pipeline import selection
from dmfc.pipeline.kinds import KINDS
from tests.support.plan_stages import PLANNING, refs, shapes

ROOT = Path(__file__).resolve().parents[2]
GOOD = ["shape/box", "shape/cup"]
MIXED = ["shape/box", "shape/broken", "shape/cup", "shape/crash"]


@pytest.fixture
def dmfc(capsys, monkeypatch, tmp_path):
    """Runs `dmfc ...` on the test shapes in this process: (status, standard output, error)."""
    for name, kind in PLANNING.items():
        monkeypatch.setitem(KINDS, name, kind)
    monkeypatch.setattr(selection, "list_refs", refs)
    monkeypatch.setattr("dmfc.engine.engine.RayPool", LocalPool)

    def call(*arguments: object) -> tuple[int, str, str]:
        options = ("--preset", "smoke", "--store", tmp_path / "store")
        monkeypatch.setattr(sys, "argv", ["dmfc", *map(str, (*arguments, *options))])
        with pytest.raises(SystemExit) as ended:
            cli.main()
        status = ended.value.code
        return (status if isinstance(status, int) else 0), *capsys.readouterr()

    return call


def test_an_object_that_fails_is_a_row_and_the_others_are_planned_and_copied(dmfc, tmp_path):
    out = tmp_path / "library"
    status, text, err = dmfc("grasps", "plan", *MIXED, "--out", out, "--json")
    assert status == 1
    assert "2 of 4 objects failed" in err
    rows = json.loads(text)
    assert [row["object"] for row in rows] == [*MIXED, "all 2"]
    assert [row["grasps"] for row in rows] == [20, None, 20, None, 40]
    assert all(list(row) == list(rows[0]) for row in rows)
    reasons = [row["failure"] for row in rows]
    assert reasons[0] is reasons[2] is reasons[4] is None
    assert "the mesh has no volume" in reasons[1]
    assert reasons[3] == "ValueError: singular matrix"
    assert sorted(path.name for path in out.glob("shadow/*")) == [
        "shape__box.parquet", "shape__cup.parquet"
    ]  # fmt: skip

    # Nothing is tried again, and the failures are still told; a table shows them too.
    status, again, _ = dmfc("grasps", "plan", *MIXED, "--json")
    assert (status, json.loads(again)) == (1, rows)
    status, text, _ = dmfc("grasps", "plan", *MIXED)
    assert status == 1
    assert "singular matrix" in text


def test_export_writes_the_others_where_an_object_fails(dmfc, tmp_path, monkeypatch):
    """What is written of an object is tested in test_exchange."""

    def write(grasps, hand_map, hand, description, model, folder):
        (folder / model.id.replace("/", "__")).mkdir(parents=True)
        return len(grasps)

    monkeypatch.setattr("dmfc.grasps.exchange.dexgraspbench.write", write)
    out = tmp_path / "out"
    status, text, err = dmfc("grasps", "export", *MIXED, "--out", out, "--json")
    assert status == 1
    assert "2 of 4 objects failed" in err
    rows = json.loads(text)
    assert [row["grasps"] for row in rows] == [20, None, 20, None]
    assert "the mesh has no volume" in rows[1]["failure"]
    assert sorted(path.name for path in out.iterdir()) == ["shape__box", "shape__cup"]


def test_status_of_planning(dmfc, tmp_path):
    assert dmfc("grasps", "plan", *GOOD)[0] == 0
    none = ["--set", "grasps.max_checks=1", "--json", "--out", tmp_path / "library"]
    status, text, err = dmfc("grasps", "plan", *GOOD, *none)
    assert status == 1
    assert not (tmp_path / "library").exists()
    assert [row["grasps"] for row in json.loads(text)] == [0, 0, 0]
    assert "no object has a grasp" in err
    status, text, _ = dmfc("grasps", "plan", "shape/broken", "--json")
    assert status == 1
    (row,) = json.loads(text)
    assert (row["object"], row["grasps"]) == ("shape/broken", None)


@pytest.mark.parametrize("scenes", [0, 1])
def test_stats_tell_failures_and_what_is_not_planned(dmfc, scenes):
    dmfc("grasps", "plan", *MIXED)
    status, text, err = dmfc("grasps", "stats", *MIXED, "shape/tall", "--scenes", scenes, "--json")
    assert status == 0, err
    assert "1 of 5 grasp sets are not planned yet" in err
    told = json.loads(text)
    assert [row["object"] for row in told["objects"]] == MIXED
    assert [row["grasps"] for row in told["objects"]] == [20, None, 20, None]
    assert told["objects"][3]["failure"] == "ValueError: singular matrix"
    assert told["all"]["grasps"] == 40
    assert ("positive_seeds" in told["all"]) == (scenes > 0)
    for row in (told["objects"][0], told["all"]):
        assert 0 <= row["power"] + row["precision"] <= 1
    status, text, _ = dmfc("grasps", "stats", "shape/broken", "--json")
    assert status == 1
    assert json.loads(text)["all"] is None


def test_preparing_tells_failures(dmfc):
    status, text, err = dmfc("objects", "prepare", *MIXED, "--json")
    assert status == 1
    assert "1 of 4 objects failed" in err
    rows = json.loads(text)
    assert [row["object"] for row in rows] == MIXED
    assert [row["faces"] is None for row in rows] == [False, True, False, False]
    assert "no volume" in rows[1]["failure"]
    assert dmfc("objects", "prepare", *GOOD)[0] == 0


def test_a_killed_planning_goes_on_where_it_was(tmp_path):
    """SIGKILL in the third object keeps two; the same command then makes what a calm one does."""
    names = sorted(shapes())[:5]

    def command(store: str, seconds: float) -> subprocess.Popen:
        call = [sys.executable, "-m", "tests.support.plan_stages", tmp_path / f"{store}.log"]
        call += [str(seconds), "grasps", "plan", *names, "--preset", "smoke"]
        call += ["--store", tmp_path / store, "--out", tmp_path / store / "out"]
        environment = {**os.environ, "PYTHONPATH": str(ROOT)}
        return subprocess.Popen(call, cwd=ROOT, env=environment, stdout=subprocess.DEVNULL)

    def planned(store: str) -> list[str]:
        log = tmp_path / f"{store}.log"
        return log.read_text().split() if log.exists() else []

    killed = command("one", 0.5)
    end = time.monotonic() + 60
    while len(planned("one")) < 2 and time.monotonic() < end:
        time.sleep(0.02)
    time.sleep(0.2)
    killed.send_signal(signal.SIGKILL)
    killed.wait()
    before = planned("one")
    assert 2 <= len(before) < len(names)
    assert command("one", 0.0).wait(60) == 0
    assert command("calm", 0.0).wait(60) == 0
    assert sorted(planned("one")) == names
    assert sorted(planned("calm")) == names
    files = [sorted((tmp_path / store / "out").rglob("*.parquet")) for store in ("one", "calm")]
    assert [path.name for path in files[0]] == [path.name for path in files[1]]
    assert all(a.read_bytes() == b.read_bytes() for a, b in zip(*files, strict=True))
