"""MLflow shows what the ledger holds; projecting again changes nothing."""

from pathlib import Path

import fake_science
import pytest
from mlflow.entities import ViewType
from mlflow.tracking import MlflowClient

from dmfc.errors import DmfcError
from dmfc.tracking import project
from dmfc.tracking.project import TAG_CELL, TAG_PARENT, project_sweep


def runs(client, experiment):
    found = client.search_runs([experiment], run_view_type=ViewType.ACTIVE_ONLY)
    parents = [run for run in found if TAG_PARENT not in run.data.tags]
    children = {run.data.tags[TAG_CELL]: run for run in found if TAG_PARENT in run.data.tags}
    assert len(parents) + len(children) == len(found)
    return parents, children


def snapshot(client, experiment):
    """Everything about all active runs that a person could see."""
    parents, children = runs(client, experiment)
    seen = {}
    for run in [*parents, *children.values()]:
        run_id = run.info.run_id
        history = {
            name: [(m.step, m.value, m.timestamp) for m in client.get_metric_history(run_id, name)]
            for name in run.data.metrics
        }
        files = sorted(entry.path for entry in client.list_artifacts(run_id))
        seen[run.info.run_name] = (
            run_id, run.info.status, run.info.start_time, run.info.end_time,
            dict(run.data.params), dict(run.data.tags), history, files,
        )  # fmt: skip
    return seen


def test_a_sweep_becomes_a_parent_and_its_children(finished):
    tracked = project_sweep(finished.ledger, finished.description, finished.table, "FAILED")
    client = MlflowClient(tracked.uri)
    parents, children = runs(client, tracked.experiment_id)
    assert [run.info.run_id for run in parents] == [tracked.run_id]
    assert parents[0].info.status == "FAILED"
    assert set(children) == {
        f"{name}-seed0" for name in ("pretrained", "all", "broken", "planner", "random")
    }
    assert {run.data.tags[TAG_PARENT] for run in children.values()} == {tracked.run_id}
    status = {name: run.info.status for name, run in children.items()}
    assert status.pop("broken-seed0") == "FAILED"
    assert set(status.values()) == {"FINISHED"}
    assert "not finite" in children["broken-seed0"].data.tags["dmfc.failure"]

    run = children["all-seed0"]
    assert run.data.params["losses.weights.guidance"] == "2.0"
    assert run.data.params["training.pretrain.epochs"] == "2"
    history = client.get_metric_history(run.info.run_id, "pretrain/train/loss")
    assert [(point.step, point.value) for point in history] == [(0, 1.0), (1, 0.5)]
    assert "finetune/train/loss" in run.data.metrics
    row = next(row for row in finished.table.rows if row.name == "all")
    assert run.data.metrics["overall"] == row.rates.overall.value
    assert parents[0].data.metrics["all.overall"] == row.rates.overall.value
    assert run.info.start_time <= run.info.end_time
    names = [entry.path for entry in client.list_artifacts(run.info.run_id)]
    assert "config.yaml" in names
    stage = [entry.path for entry in client.list_artifacts(run.info.run_id, "00-pretrain")]
    assert "00-pretrain/pictures" in stage
    parent_files = {entry.path for entry in client.list_artifacts(tracked.run_id)}
    assert {"sweep.json", "table.md", "table.csv", "table.tex", "trials.parquet"} <= parent_files


def test_projecting_twice_changes_nothing(finished, monkeypatch):
    given = (finished.ledger, finished.description, finished.table, "FAILED")
    tracked = project_sweep(*given)
    client = MlflowClient(tracked.uri)
    before = snapshot(client, tracked.experiment_id)

    marker = finished.ledger.store / "sweeps" / finished.description["id"] / "tracked.json"
    marker.unlink()
    assert project_sweep(*given) == tracked
    assert snapshot(client, tracked.experiment_id) == before

    def forbidden(*_):
        raise AssertionError("MLflow was opened though nothing had changed")

    monkeypatch.setattr(project, "_Writer", forbidden)
    assert project_sweep(*given) == tracked


def test_a_half_written_run_is_replaced(finished):
    given = (finished.ledger, finished.description, finished.table, "FAILED")
    tracked = project_sweep(*given)
    client = MlflowClient(tracked.uri)
    before = snapshot(client, tracked.experiment_id)
    _, children = runs(client, tracked.experiment_id)
    half = children["all-seed0"].info.run_id
    client.delete_tag(half, project.TAG_DIGEST)
    client.log_metric(half, "pretrain/train/loss", 99.0, step=1)
    client.update_run(half, "RUNNING")

    marker = finished.ledger.store / "sweeps" / finished.description["id"] / "tracked.json"
    marker.unlink()
    project_sweep(*given)
    after = snapshot(client, tracked.experiment_id)
    assert after["all-seed0"][0] != half
    assert {name: seen[1:] for name, seen in after.items()} == {
        name: seen[1:] for name, seen in before.items()
    }


def test_a_cell_that_is_repaired_becomes_finished(finished, monkeypatch):
    given = (finished.ledger, finished.description)
    tracked = project_sweep(*given, finished.table, "FAILED")
    monkeypatch.setattr(fake_science, "finetune", lambda ctx: fake_science._learn(ctx, "finetune"))
    again = type(finished)(finished.ledger.store.parent)
    project_sweep(again.ledger, again.description, again.table, "FINISHED")
    parents, children = runs(MlflowClient(tracked.uri), tracked.experiment_id)
    assert parents[0].info.status == "FINISHED"
    assert {run.info.status for run in children.values()} == {"FINISHED"}
    assert "dmfc.failure" not in children["broken-seed0"].data.tags


def test_long_parameters_are_cut_and_kept_whole_in_the_config(finished):
    cell = finished.description["cells"][0]
    cell["config"]["objects"]["train"] = ["procedural:cup-0001"] * 50
    tracked = project_sweep(finished.ledger, finished.description, finished.table, "FINISHED")
    client = MlflowClient(tracked.uri)
    _, children = runs(client, tracked.experiment_id)
    run = children["pretrained-seed0"]
    assert len(run.data.params["objects.train"]) == 250
    path = Path(client.download_artifacts(run.info.run_id, "config.yaml"))
    assert path.read_text().count("procedural:cup-0001") == 50


def test_a_damaged_metrics_file_is_one_line(finished):
    address = finished.description["cells"][0]["model"]
    (finished.ledger.folder(address) / "metrics.jsonl").write_text('{"epoch": 0')
    with pytest.raises(DmfcError, match="cannot be read"):
        project_sweep(finished.ledger, finished.description, finished.table, "FINISHED")
