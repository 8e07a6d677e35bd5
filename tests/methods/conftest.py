"""A store whose test scenes are made, and the method of docs/benchmark.md in an empty folder."""

from __future__ import annotations

import pytest

from tests.support.pages import write_files

SETTINGS = {
    "objects.test": ["procedural/can-0005", "procedural/ball-0003"],
    "objects.train": ["procedural/box-0000"],
    "grasps.source": "library",
    "execution.grasps_per_scene": 2,
}


@pytest.fixture(scope="module")
def store(tmp_path_factory, shadow_hand_dir):
    return tmp_path_factory.mktemp("lab") / "store"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """With `my_method.py`, `my_table.yaml` and `answer.py` of the page."""
    place = tmp_path_factory.mktemp("mine")
    write_files("benchmark.md", place)
    return place


@pytest.fixture
def lab(store, folder, monkeypatch):
    """An experiment with two test scenes, in that folder; stages run in this process."""
    import dmfc
    from dmfc.engine.pools import LocalPool

    monkeypatch.chdir(folder)
    monkeypatch.syspath_prepend(str(folder))
    monkeypatch.setattr("dmfc.engine.engine.RayPool", LocalPool)
    monkeypatch.setattr("dmfc.experiment.drive._track", lambda plan, ledger: {})
    return dmfc.Experiment("smoke", SETTINGS, store)
