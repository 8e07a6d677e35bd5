"""A password in an address is used and never written down or shown."""

import json

import pytest

from dmfc.errors import DmfcError, masked
from tests.cli.test_cli import no_science  # noqa: F401  # a fixture

SECRET = "hunter2"


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        (f"postgresql://u:{SECRET}@h/db", "postgresql://***@h/db"),
        (f"see https://{SECRET}@h:50/x", "see https://***@h:50/x"),
        (f"mysql+pymysql://:{SECRET}@h", "mysql+pymysql://***@h"),
        (f"https://u:p@{SECRET}@h/x", "https://***@h/x"),
        (f"https://u:a/{SECRET}@h/x", "https://***@h/x"),
        (f"s3://k:{SECRET}@b and s3://{SECRET}@c", "s3://***@b and s3://***@c"),
        (f"postgresql://h/d?password={SECRET}&a=1", "postgresql://h/d?password=***&a=1"),
        (f"https://h/?access_token={SECRET}", "https://h/?access_token=***"),
        ("sqlite:////home/a@b/mlflow.db", "sqlite:////home/a@b/mlflow.db"),
        ("http://127.0.0.1:5000 and me@home.org", "http://127.0.0.1:5000 and me@home.org"),
        ("scenes.test.kind=single", "scenes.test.kind=single"),
    ],
)
def test_masked(text, shown):
    assert masked(text) == shown
    assert str(DmfcError(text)) == shown


def test_nothing_of_a_sweep_holds_the_password(dmfc, no_science, tmp_path, monkeypatch):  # noqa: F811
    monkeypatch.setattr("dmfc.tracking.store.time.sleep", lambda _: None)
    uri = f"run.tracking_uri=http://user:{SECRET}@127.0.0.1:1/"
    call = ("sweep", "table2", "--preset", "smoke", "--store", tmp_path)
    _, out, err = dmfc(*call, "--set", uri)
    assert "no MLflow server answers at 'http://***@127.0.0.1:1/'" in err
    assert SECRET not in out + err
    *_, answer, error = dmfc(*call, "--set", uri, "--json")
    assert SECRET not in answer + error
    _, out, _ = dmfc("tracking", "sync", "--store", tmp_path)  # into the store's own database
    (folder,) = (tmp_path / "sweeps").iterdir()
    assert "***@127.0.0.1" in (folder / "sweep.json").read_text()
    assert "***@127.0.0.1" in (folder / "provenance.json").read_text()
    assert "***@127.0.0.1" in (folder / "table.html").read_text()
    files = [path for path in tmp_path.rglob("*") if path.is_file()]
    assert len(files) > 50
    assert [path for path in files if SECRET.encode() in path.read_bytes()] == []


def test_a_server_with_a_password_is_linked_to_without(dmfc, no_science, tmp_path, monkeypatch):  # noqa: F811
    """Projected into a file instead, since no server is here; the marker is what is looked at."""
    from dmfc.tracking import project
    from dmfc.tracking.store import tracking_uri
    from dmfc.tracking.writer import Writer

    dmfc("sweep", "table2", "--preset", "smoke", "--store", tmp_path, "--json")
    from dmfc.engine.ledger import Ledger

    (folder,) = (tmp_path / "sweeps").iterdir()
    ledger, uri = Ledger(tmp_path), f"https://user:{SECRET}@mlflow.lab/"
    asked = []

    def writer(given):
        asked.append(given)
        return Writer(tracking_uri(ledger))

    project.project_sweep(ledger, folder.name, uri, writer)
    assert asked == [uri]
    assert json.loads((folder / "tracked.json").read_text())["uri"] == "https://mlflow.lab/"


def test_the_writer_beside_the_driver_has_no_password_in_its_arguments(ledger):
    import psutil

    from dmfc.tracking.live import LiveTracking

    live = LiveTracking(ledger, [], f"http://user:{SECRET}@127.0.0.1:1/", 0.001)
    while live._process is None:
        live.tick()
    process = psutil.Process(live._process.pid)
    assert SECRET not in " ".join(process.cmdline())
    live.finish()
    assert not process.is_running()
    assert live._process.returncode == 0
