"""`dmfc view` as a user calls it."""

from __future__ import annotations

import base64
import json
import os
import re
import signal
import socket
import subprocess
import sys
import threading
import urllib.request
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from tests.support import clouds

ROOT = Path(__file__).resolve().parents[2]
PATIENCE = 300


@pytest.fixture(scope="module")
def box_file(tmp_path_factory):
    path = tmp_path_factory.mktemp("cloud") / "box.npy"
    np.save(path, clouds.cloud(clouds.box()))
    return path


def test_served_are_the_bytes_of_the_export(dmfc, box_file, tmp_path, shadow_hand_dir):
    out = tmp_path / "new" / "page.html"
    status, told, _ = dmfc("view", box_file, "--export", out)
    assert status == 0
    assert "page.html" in told
    code = "from dmfc.cli.main import main; main()"
    server = subprocess.Popen(
        [sys.executable, "-c", code, "view", box_file],
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": str(ROOT), "PYTHONUNBUFFERED": "1"},
    )
    watchdog = threading.Timer(PATIENCE, server.kill)
    watchdog.start()
    assert server.stdout is not None
    printed = [server.stdout.readline(), server.stdout.readline()]
    watchdog.cancel()
    found = re.search(r"http://127\.0\.0\.1:\d+/", printed[0])
    assert found, printed
    with urllib.request.urlopen(found[0]) as answer:
        assert answer.read() == out.read_bytes()
    server.send_signal(signal.SIGTERM)
    assert server.wait(PATIENCE) == 0
    assert server.stdout.read() == "ended\n"


def test_a_port_in_use_is_said(dmfc, box_file, shadow_hand_dir):
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        status, _, err = dmfc("view", box_file, "--port", port)
    assert status == 1
    assert f"cannot listen on 127.0.0.1, port {port}" in err
    assert len(err.strip().splitlines()) == 1


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["nowhere.npy"], "there is no file 'nowhere.npy'"),
        (["planner", "--trial", "3"], "--trial wants scene:trial"),
        (["planner", "--trial", "3:0", "--scene", "3"], "leave --scene out"),
        (["plannr", "--scene", "0"], "unknown model 'plannr'"),
    ],
)
def test_errors_are_one_line(dmfc, arguments, told):
    status, _, err = dmfc("view", *arguments)
    assert status == 1
    assert told in err
    assert len(err.strip().splitlines()) == 1


def test_a_page_that_cannot_be_written_is_said(dmfc, box_file, tmp_path, shadow_hand_dir):
    (tmp_path / "file").touch()
    status, _, err = dmfc("view", box_file, "--export", tmp_path / "file" / "page.html")
    assert status == 1
    assert "is a file, not a folder" in err
    assert len(err.strip().splitlines()) == 1


@pytest.mark.full
def test_a_trial_ends_as_its_evaluation_says(tmp_path, shadow_hand_dir):
    """Makes objects, grasps and a scene of the smallest preset, and executes them."""
    out, store = tmp_path / "page.html", tmp_path / "store"
    code = "from dmfc.cli.main import main; main()"
    call = ["view", "planner", "--trial", "0:1", "--preset", "smoke", "--store", store]
    done = subprocess.run(
        [sys.executable, "-c", code, *map(str, call), "--export", str(out)],
        capture_output=True,
        text=True,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        check=False,
    )
    assert done.returncode == 0, done.stderr
    (written,) = (store / "stages" / "evaluate").glob("*/trials.parquet")
    row = pd.read_parquet(written).set_index(["scene", "trial"]).loc[(0, 1)]
    found = re.search(r'<script type="application/json" id="data">(.*?)</script>', out.read_text())
    assert found
    shown = json.loads(found[1])
    assert shown["title"] == f"trial 0:1, planner: {row['reason'] or 'held'}"
    assert shown["object_names"] == [row["object"]]
    spent = row[[name for name in row.index if name.startswith("seconds_")]].sum()
    seconds = np.frombuffer(base64.b64decode(shown["motion"]["seconds"]["base64"]), "<f4")
    assert seconds[-1] == pytest.approx(spent, abs=1e-3)
