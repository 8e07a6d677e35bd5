"""A store that is copied or moved is whole by itself: nothing outside it is ever written."""

import hashlib
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from mlflow.tracking import MlflowClient

from dmfc.engine.ledger import Ledger
from dmfc.engine.state import write_state
from dmfc.files.sealed import write_sealed
from dmfc.report.page import read_marker
from dmfc.tracking.project import VERSION, project_stale, project_sweep
from dmfc.tracking.store import database, sqlite_path, sqlite_uri, tracking_uri
from tests.tracking.conftest import SWEEP, FinishedSweep

MORE = "  more: {model: finetuned, set: {losses.weights.guidance: 3}}\n"


def everything(folder: Path) -> dict[str, tuple[str, int]]:
    """Content and time of change of each file, folders too."""
    return {
        str(path.relative_to(folder)): (
            hashlib.sha256(path.read_bytes()).hexdigest() if path.is_file() else "",
            path.stat().st_mtime_ns,
        )
        for path in sorted(folder.rglob("*"))
    }


def all_files(uri: str, folder: Path) -> int:
    """Download every file of every run; how many there were."""
    client = MlflowClient(uri)
    runs = client.search_runs([e.experiment_id for e in client.search_experiments()])
    for run in runs:
        assert run.info.artifact_uri.startswith(folder.as_uri())
        client.download_artifacts(run.info.run_id, "")
    for version in client.search_model_versions():
        assert version.source.startswith(folder.as_uri())
        assert client.get_model_version_download_uri(version.name, version.version).startswith(
            folder.as_uri()
        )
    assert {
        experiment.artifact_location.startswith(folder.as_uri())
        for experiment in client.search_experiments()
    } == {True}
    return len(runs)


def with_tests() -> dict[str, str]:
    """The environment of a process that imports what is here."""
    return {**os.environ, "PYTHONPATH": str(Path(__file__).resolve().parents[2])}


def go_on(folder: str) -> None:
    """Run a larger sweep in the store in `folder`, and finish what is said of the old one."""
    larger = FinishedSweep(Path(folder), SWEEP + MORE)
    project_sweep(larger.ledger, larger.id)
    (marker,) = set(larger.ledger.store.glob("sweeps/*/tracked.json")) - {
        larger.folder / "tracked.json"
    }
    write_sealed(marker, VERSION, {**read_marker(marker.parent), "status": "RUNNING"})
    (marker.parent / "table.md").write_text("changed")
    write_state(marker.parent, "KILLED", {})
    assert project_stale(larger.ledger) == [marker.parent.name]


def test_a_sweep_on_a_copy_leaves_the_original_alone(finished, tmp_path, monkeypatch):
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    monkeypatch.chdir(elsewhere)
    write_state(finished.folder, "FINISHED", {})  # so its best model is registered
    project_sweep(finished.ledger, finished.id)
    original, other = finished.ledger.store, tmp_path / "o t%20h?er#"
    before = everything(original)
    other.mkdir()
    subprocess.run(["cp", "-r", original, other / "store"], check=True)
    there = set(everything(tmp_path)) - {
        name for name in everything(tmp_path) if name.startswith(other.name)
    }

    # In a process of its own: MLflow remembers where the files of a run are.
    work_on_copy = f"from tests.tracking.test_moved import go_on; go_on({str(other)!r})"
    subprocess.run([sys.executable, "-c", work_on_copy], check=True, env=with_tests())

    assert everything(original) == before
    outside = {name for name in everything(tmp_path) if not name.startswith(other.name)}
    assert outside == there
    assert list(elsewhere.iterdir()) == []
    shutil.rmtree(original)
    copy = Ledger(other / "store")
    count = f"""
from pathlib import Path
from tests.tracking.test_moved import all_files
print(all_files({tracking_uri(copy)!r}, Path({str(copy.store / "mlflow")!r})))
"""
    counted = subprocess.run(
        [sys.executable, "-c", count], check=True, env=with_tests(), capture_output=True, text=True
    )
    assert counted.stdout.split()[-1] == "13"


def test_a_moved_store_knows_its_runs(finished, tmp_path):
    tracked = project_sweep(finished.ledger, finished.id)
    moved = tmp_path / "a" / "b"
    moved.parent.mkdir()
    finished.ledger.store.rename(moved)
    again = project_sweep(Ledger(moved), finished.id)
    assert again.run_id == tracked.run_id  # nothing was to be done, and the marker says so
    (moved / "sweeps" / finished.id / "tracked.json").unlink()
    assert project_sweep(Ledger(moved), finished.id).run_id == tracked.run_id
    assert not finished.ledger.store.exists()
    assert all_files(tracking_uri(Ledger(moved)), moved / "mlflow") == 6


def test_a_marker_of_an_older_version_names_this_store(finished, tmp_path):
    """Such a marker has the address that the store had when it was written."""
    project_sweep(finished.ledger, finished.id)
    marker = finished.folder / "tracked.json"
    told = json.loads(marker.read_text())
    del told["version"], told["sha256"]
    address = f"sqlite:///{tmp_path}/gone/mlflow/mlflow.db"
    marker.write_text(json.dumps({**told, "uri": address, "status": "RUNNING"}))
    assert project_stale(finished.ledger) == [finished.id]
    assert not (tmp_path / "gone").exists()


@pytest.mark.parametrize("name", ["plain", "a?b", "a%20b", "a b#c", "ä%3F&=+"])
def test_the_uri_of_a_database_names_that_file(tmp_path, name, monkeypatch, empty_database):
    (tmp_path / "work").mkdir()
    monkeypatch.chdir(tmp_path / "work")
    path = tmp_path / name / "mlflow.db"
    path.parent.mkdir()
    shutil.copy(empty_database, path)
    assert sqlite_path(sqlite_uri(path)) == path
    before = path.read_bytes()
    MlflowClient(sqlite_uri(path)).create_experiment("x", "file:///x")
    assert path.read_bytes() != before
    assert {item.name for item in tmp_path.iterdir()} == {"work", name}
    assert list((tmp_path / "work").iterdir()) == []


def test_a_damaged_database_is_named(finished):
    from dmfc.errors import DmfcError
    from dmfc.tracking.moved import copy_database, set_locations

    path = database(finished.ledger)
    path.write_bytes(b"SQLite format 3\0" + b"\xff" * 4096)
    with pytest.raises(DmfcError, match=r"mlflow\.db' cannot be used.*tracking rebuild"):
        set_locations(path, path.parent)
    with pytest.raises(DmfcError, match=r"mlflow\.db' cannot be read"):
        copy_database(path, path.with_name("copy.db"))
