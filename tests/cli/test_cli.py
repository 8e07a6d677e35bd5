"""The command: what it prints, what it writes, and how it fails."""

from __future__ import annotations

import errno
import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest
import typer
from typer.core import TyperGroup

from dmfc.cli import main as cli
from dmfc.config.shipped import shipped_names
from dmfc.engine.pools import LocalPool
from dmfc.engine.state import read_state
from dmfc.files.sealed import write_sealed
from dmfc.pipeline import selection
from dmfc.pipeline.kinds import KINDS
from dmfc.report.page import read_marker
from tests.support.fake_science import FAKES, fake_refs

ROOT = Path(__file__).resolve().parents[2]


def verbs(command, words=()):
    """The words of every command of the app: ('grasps', 'plan')."""
    if not isinstance(command, TyperGroup):
        return [words]
    return [found for name, sub in command.commands.items() for found in verbs(sub, (*words, name))]


VERBS = verbs(typer.main.get_command(cli.app))


@pytest.fixture
def no_science(monkeypatch, tmp_path, empty_database):
    """All stages without their science, run in this process."""
    for name, fake in FAKES.items():
        monkeypatch.setitem(KINDS, name, fake)
    monkeypatch.setattr(selection, "list_refs", fake_refs)
    monkeypatch.setattr("dmfc.engine.engine.RayPool", LocalPool)
    (tmp_path / "mlflow").mkdir()
    shutil.copy(empty_database, tmp_path / "mlflow")


@pytest.mark.parametrize("verb", VERBS, ids=" ".join)
def test_every_verb_has_help(dmfc, verb):
    status, out, _ = dmfc(*verb, "--help")
    assert status == 0
    assert "Usage: dmfc" in out
    if verb == ("sweep", "run"):
        assert all(name in out for name in shipped_names("configs"))
    if verb[0] in ("train", "evaluate", "scenes", "grasps") or verb == ("sweep", "run"):
        for option in ("--preset", "--set", "--json"):
            assert option in out
        assert ("--store" in out) == (verb != ("scenes", "import"))  # which needs no store


def test_the_verbs_are_those_of_the_app():
    assert {("view",), ("compare",), ("grasps", "export"), ("store", "import")} <= set(VERBS)
    assert len(set(VERBS)) == len(VERBS) >= 34


@pytest.mark.parametrize(
    ("arguments", "part"),
    [
        (["sweep", "tabel1"], "did you mean 'table1'"),
        (["sweep", "table1", "--preset", "smok"], "did you mean 'smoke'"),
        (["train", "--set", "losses.weights.colision=1"], "losses.weights.collision"),
        (["train", "--set", "training.batch_size=x"], "training.batch_size"),
        (["train", "--stage", "pretrian"], "did you mean 'pretrain'"),
        (["evaluate", "plannner"], "did you mean 'planner'"),
        (["evaluate", "planner", "--only", "0:0", "--dense", "0"], "give one of them"),
        (["evaluate", "planner", "--video", "trial.gif"], "name it by --only"),
        (["evaluate", "planner", "--preset", "smoke", "--only", "99:0"], "there is no scene 99"),
        (["evaluate", "planner", "--preset", "smoke", "--only", "0:99"], "has no trial 99"),
        (["evaluate", "planner", "--preset", "smoke", "--dense", "99"], "there is no scene 99"),
        (["view", "planner", "--preset", "smoke", "--scene", "99"], "there is no scene 99"),
        (["scenes", "make", "--split", "tset"], "did you mean 'test'"),
        (["objects", "prepare", "ycp:mug"], "ycb"),
        (["objects", "prepare", "folder:/nowhere/mesh.stl"], "/nowhere/mesh.stl"),
        (["train", "--set", "objects.train=[]"], "objects.train selects no object"),
        (["assets", "pull", "ycbb"], "did you mean 'ycb'"),
        (["tables"], "no sweeps in the store"),
        (["store", "verify"], "no finished stages in the store"),
        (["store", "list", "objct"], "unknown kind of stage 'objct'"),
        (["ui"], "no runs in the store"),
    ],
)
def test_a_mistake_is_one_line_and_status_one(dmfc, tmp_path, arguments, part):
    store = [] if arguments[0] == "assets" else ["--store", tmp_path / "store"]
    status, out, err = dmfc(*arguments, *store)
    assert status == 1
    assert out == ""
    assert err.startswith("error: ")
    assert err.count("\n") == 1
    assert part in err
    assert "Traceback" not in err


def test_wrong_usage_is_status_two(dmfc):
    status, _, err = dmfc("sweep", "table1", "--presett", "smoke")
    assert status == 2
    assert "--preset" in err
    assert "Traceback" not in err


def test_an_unexpected_error_is_one_line_unless_debugging(dmfc, monkeypatch, capsys):
    def broken(*_):
        raise RuntimeError("first line\nsecond line")

    monkeypatch.setattr("dmfc.report.collect.list_sweeps", broken)
    status, _, err = dmfc("tables")
    assert status == 1
    assert err == "error: unexpected RuntimeError: first line (add --debug for the traceback)\n"
    monkeypatch.setattr(sys, "argv", ["dmfc", "tables", "--debug"])
    with pytest.raises(RuntimeError):
        cli.main()


def test_a_sweep_from_file_to_table(dmfc, no_science, tmp_path, monkeypatch):
    arguments = ("sweep", "table1", "--preset", "smoke", "--store", tmp_path, "--json")
    status, out, err = dmfc(*arguments)
    assert status == 0, err
    first = json.loads(out)
    assert first["id"].startswith("table1-")
    assert list(first["cells"]) == [
        "pretrained", "collision", "guidance", "q1_upper", "all",
        "pretrained_checked", "all_checked", "planner", "random",
    ]  # fmt: skip
    cell = first["cells"]["all"]
    assert [address.split("/")[0] for address in cell["stages"]][:2] == ["pretrain", "finetune"]
    assert cell["rates"]["overall"]["n"] == cell["trials"]
    assert cell["paper"]["overall"] == [0.56, 0.02]
    assert first["stages_run"] > 10
    for name in ("table.md", "table.csv", "table.tex", "table.json", "trials.parquet"):
        assert (Path(first["folder"]) / name).is_file()

    def forbidden(*_):
        raise AssertionError("started though all is done")

    monkeypatch.setattr("dmfc.engine.engine.RayPool", forbidden)
    monkeypatch.setattr("dmfc.tracking.writer.Writer.__init__", forbidden)
    status, out, _ = dmfc(*arguments)
    second = json.loads(out)
    assert status == 0
    assert second["stages_run"] == 0
    assert second["cells"] == first["cells"]

    status, out, _ = dmfc(*arguments[:-1])
    assert status == 0
    assert "Table I: one object, random pose (smoke)" in out
    assert "planner (ceiling)" in out
    assert "0.56 ± 0.02" in out

    status, out, _ = dmfc("tables", "table1", "--store", tmp_path, "--json")
    assert json.loads(out)[0]["cells"]["all"]["rates"] == cell["rates"]

    status, out, _ = dmfc(*arguments, "--dry-run")
    listed = json.loads(out)
    assert {stage["done"] for stage in listed["stages"]} == {True}
    status, out, _ = dmfc(*arguments, "--dry-run", "--set", "execution.min_confidence=0.3")
    listed = json.loads(out)
    whys = {stage["why"] for stage in listed["stages"] if not stage["done"]}
    assert whys == {"execution.min_confidence 0.15 -> 0.3"}
    kinds = {kind["kind"]: kind for kind in listed["kinds"]}
    assert kinds["evaluate"]["done"] == 0
    assert kinds["finetune"]["done"] == kinds["finetune"]["stages"] == 4


def test_a_dry_run_writes_nothing(dmfc, no_science, tmp_path):
    status, out, _ = dmfc("sweep", "table2", "--preset", "smoke", "--store", tmp_path, "--dry-run")
    assert status == 0
    assert "pretrained" in out
    assert [path.name for path in tmp_path.iterdir()] == ["mlflow"]


def test_a_failed_cell_is_told_and_the_others_stand(dmfc, no_science, tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text(
        "cells:\n  good: {model: pretrained}\n"
        "  bad: {model: finetuned, set: {losses.weights.guidance: 13}}\n"
    )
    status, out, _ = dmfc("sweep", path, "--preset", "smoke", "--store", tmp_path, "--json")
    assert status == 1
    answer = json.loads(out)
    assert "not finite" in answer["cells"]["bad"]["failure"]
    assert answer["cells"]["bad"]["rates"]["overall"]["value"] == 0.0
    assert answer["cells"]["good"]["failure"] is None


def test_a_full_disk_is_one_line_and_the_same_line_goes_on(dmfc, no_science, tmp_path, monkeypatch):
    call = ("sweep", "table2", "--preset", "smoke", "--store", tmp_path, "--json")
    with monkeypatch.context() as full:

        def no_space(*_, **__):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

        full.setattr("dmfc.engine.state.write_json", no_space)
        status, out, err = dmfc(*call)
    assert (status, out) == (1, "")
    last = err.splitlines()[-1]
    assert "No space left on device" in last
    assert "run the same line again" in last
    status, out, _ = dmfc(*call)
    assert status == 0
    assert all(cell["failure"] is None for cell in json.loads(out)["cells"].values())


def test_a_tracking_server_that_is_away_costs_no_result(dmfc, no_science, tmp_path, monkeypatch):
    monkeypatch.setattr("dmfc.tracking.store.time.sleep", lambda _: None)
    call = ("sweep", "table2", "--preset", "smoke", "--store", tmp_path, "--json")
    with socket.socket() as taken:  # bound, but nobody listens
        taken.bind(("127.0.0.1", 0))
        uri = f"http://127.0.0.1:{taken.getsockname()[1]}"
        status, out, err = dmfc(*call, "--set", f"run.tracking_uri={uri}")
    assert status == 1
    assert err.splitlines()[0].startswith(f"no MLflow server answers at '{uri}'")
    assert err.splitlines()[0].endswith("the sweep goes on")
    first = json.loads(out)
    assert "no MLflow server answers" in first["mlflow"]["error"]
    assert (Path(first["folder"]) / "table.html").is_file()
    status, out, _ = dmfc(*call)
    assert status == 0
    assert json.loads(out)["cells"] == first["cells"]
    assert json.loads(out)["mlflow"]["uri"].startswith("sqlite")


def test_ui_of_a_sweep_on_a_server_links_to_it(dmfc, no_science, tmp_path):
    dmfc("sweep", "table2", "--preset", "smoke", "--store", tmp_path, "--json")
    (marker,) = tmp_path.glob("sweeps/*/tracked.json")
    told = read_marker(marker.parent) | {"uri": "https://mlflow.lab/"}
    write_sealed(marker, told["version"], told)
    shutil.rmtree(tmp_path / "mlflow")
    status, out, _ = dmfc("ui", "--store", tmp_path)
    page = f"https://mlflow.lab/#/experiments/{told['experiment_id']}/runs/{told['run_id']}"
    assert (status, out) == (0, f"{marker.parent.name}: {page}\n")


def test_two_sweeps_in_one_call_share_stages(dmfc, no_science, tmp_path):
    status, out, _ = dmfc(
        "sweep", "table1", "table2", "--preset", "smoke", "--store", tmp_path, "--json"
    )
    assert status == 0
    names = [entry["name"] for entry in json.loads(out)["sweeps"]]
    assert names == ["table1", "table2"]
    assert len(list((tmp_path / "stages" / "object").iterdir())) == 8


def test_evaluate_and_train_run_what_they_need(dmfc, no_science, tmp_path):
    options = ("--preset", "smoke", "--store", tmp_path, "--json")
    status, out, _ = dmfc("evaluate", "planner", *options)
    assert status == 0
    assert json.loads(out)["rates"]["valid"]["value"] == 1.0
    assert json.loads(out)["diversity"] == {"proposed": 512, "executed_position": 0.1}
    own = ("--scenes", "multi:5", "--protocol", "dexgraspbench", "--out", tmp_path / "own")
    status, out, _ = dmfc("evaluate", "random", *own, *options)
    assert json.loads(out)["trials"] == 20
    assert {path.name for path in (tmp_path / "own").iterdir()} == {
        *("trials.parquet", "diversity.parquet", "summary.json", "failures.png", "outputs.json")
    }
    status, out, _ = dmfc("compare", tmp_path / "own", tmp_path / "own", "--json")
    assert (json.loads(out)["trials"], json.loads(out)["difference"]) == (20, 0.0)
    status, out, _ = dmfc("train", "--stage", "pretrain", *options)
    assert [line["epoch"] for line in json.loads(out)["metrics"]] == [0, 1]


def test_ctrl_c_prints_the_line_that_resumes(tmp_path):
    """A real process and a real signal, between two slow stages."""
    code = (
        "import sys\n"
        "from tests.support import trivial_graph\n"
        "from dmfc.experiment import console, session\n"
        "from dmfc.engine import engine, pools\n"
        "from dmfc.engine.ledger import Ledger\n"
        "from dmfc.config.schema import Config\n"
        "from pathlib import Path\n"
        "engine.RayPool, engine.kind_of = pools.LocalPool, lambda n, k: trivial_graph.TRIVIAL[n]\n"
        "stages = [trivial_graph.trivial('slow', f's{i}', i, seconds=1) for i in range(20)]\n"
        "sys.argv = ['dmfc', 'sweep', 'my sweep.yaml']\n"
        "from dmfc.engine.watch import Progress\n"
        f"ledger = Ledger(Path({str(tmp_path)!r}))\n"
        "watcher = Progress(ledger, console.stderr(), trivial_graph.TRIVIAL)\n"
        "session.run_shown(stages, ledger, Config(), watcher)\n"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", code],
        stderr=subprocess.PIPE,
        text=True,
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )
    end = time.monotonic() + 600
    while not list(tmp_path.glob("stages/slow/*/stage.json")) and time.monotonic() < end:
        time.sleep(0.1)
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=600)
    assert "Go on with:\n  dmfc sweep 'my sweep.yaml'" in err
    done = len(list(tmp_path.glob("stages/slow/*/stage.json")))
    assert 1 <= done < 20


@pytest.mark.parametrize(
    ("where", "state"),
    [("engine.engine.RayPool", "KILLED"), ("tracking.project.project_sweep", "FINISHED")],
)
def test_ctrl_c_at_the_start_and_at_the_end_prints_it_too(
    dmfc, no_science, tmp_path, monkeypatch, where, state
):
    def interrupted(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(f"dmfc.{where}", interrupted)
    status, _, err = dmfc("sweep", "table2", "--preset", "smoke", "--store", tmp_path, "--json")
    assert status == 130
    assert f"Go on with:\n  dmfc sweep table2 --preset smoke --store {tmp_path}" in err
    (folder,) = tmp_path.glob("sweeps/*")
    assert read_state(folder).status == state


def test_doctor_answers_a_machine(dmfc, tmp_path):
    status, out, _ = dmfc("doctor", "--store", tmp_path, "--json")
    checks = {row["check"]: row for row in json.loads(out)}
    assert checks["python"]["state"] == "ok"
    assert {"torch", "mujoco", "ray", "processor", "pack ycb"} <= set(checks)
    assert status == int(any(row["state"] == "bad" for row in checks.values()))
    assert "works, the choice of renderer=auto" in checks["renderer embree"]["found"]


@pytest.mark.parametrize(
    ("reasons", "states", "chosen"),
    [
        ({"embree": "ImportError", "mujoco": ""}, ["warning", "ok"], "renderer mujoco"),
        ({"embree": "ImportError", "mujoco": "no OpenGL context"}, ["bad", "bad"], None),
    ],
)
def test_doctor_says_which_renderer_is_chosen(dmfc, monkeypatch, reasons, states, chosen):
    monkeypatch.setattr("dmfc.sensing.render.available_renderers", lambda: reasons)
    status, out, _ = dmfc("doctor", "--json")
    rows = [row for row in json.loads(out) if row["check"].startswith("renderer")]
    assert [row["state"] for row in rows] == states
    assert [row["check"] for row in rows if "renderer=auto" in row["found"]] == [
        *([chosen] if chosen else [])
    ]
    assert all(row["advice"] for row in rows if row["state"] != "ok")
    assert chosen or status == 1


def test_completion_for_shells(dmfc, monkeypatch):
    monkeypatch.setenv("_DMFC_COMPLETE", "complete_bash")
    monkeypatch.setenv("COMP_WORDS", "dmfc swe")
    monkeypatch.setenv("COMP_CWORD", "1")
    _, out, _ = dmfc()
    assert "sweep" in out
