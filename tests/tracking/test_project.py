"""MLflow shows what the ledger holds; projecting again changes nothing."""

import json
import shutil
from datetime import UTC, datetime
from pathlib import Path

import pytest
from mlflow.entities import ViewType
from mlflow.tracking import MlflowClient

from dmfc.engine.context import tell_attempt
from dmfc.engine.state import driving, read_state, write_state
from dmfc.errors import DmfcError
from dmfc.tracking.project import project_stale, project_sweep, rebuild
from dmfc.tracking.store import database
from dmfc.tracking.ui import serve
from dmfc.tracking.writer import TAG_CELL, TAG_DIGEST, TAG_PARENT
from tests.support import fake_science
from tests.tracking.conftest import FinishedSweep


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


def comparable(at):
    """The same without ids, which each database gives anew."""
    return {
        name: [*seen[1:5], {k: v for k, v in seen[5].items() if k != TAG_PARENT}, *seen[6:]]
        for name, seen in snapshot(MlflowClient(at.uri), at.experiment_id).items()
    }


def test_a_sweep_becomes_a_parent_and_its_children(finished):
    tracked = project_sweep(finished.ledger, finished.id)
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


def test_cells_of_a_matrix_get_names_that_mlflow_takes(tmp_path, empty_database):
    axes = "".join(
        f"    {term}: {{'-': {{losses.weights.{term}: 0}}, {term}: {{losses.weights.{term}: 1}}}}\n"
        for term in ("guidance", "q1_upper")
    )
    sweep = FinishedSweep(
        tmp_path, f"name: tiny\ntitle: A matrix\nmatrix:\n  model: finetuned\n  axes:\n{axes}"
    )
    database(sweep.ledger).parent.mkdir()
    shutil.copy(empty_database, database(sweep.ledger))
    tracked = project_sweep(sweep.ledger, sweep.id)
    parents, children = runs(MlflowClient(tracked.uri), tracked.experiment_id)
    assert "guidance+q1_upper-seed0" in children
    (row,) = (row for row in sweep.table.rows if row.name == "guidance+q1_upper")
    assert parents[0].data.metrics["guidance q1_upper.overall"] == row.rates.overall.value


def test_projecting_twice_changes_nothing(finished):
    given = (finished.ledger, finished.id)
    tracked = project_sweep(*given)
    client = MlflowClient(tracked.uri)
    before = snapshot(client, tracked.experiment_id)

    marker = finished.ledger.store / "sweeps" / finished.description.id / "tracked.json"
    marker.unlink()
    assert project_sweep(*given) == tracked
    assert snapshot(client, tracked.experiment_id) == before

    def forbidden(*_):
        raise AssertionError("MLflow was opened though nothing had changed")

    assert project_sweep(*given, make_writer=forbidden) == tracked


def test_a_half_written_run_is_replaced(finished):
    given = (finished.ledger, finished.id)
    tracked = project_sweep(*given)
    client = MlflowClient(tracked.uri)
    before = snapshot(client, tracked.experiment_id)
    _, children = runs(client, tracked.experiment_id)
    half = children["all-seed0"].info.run_id
    client.delete_tag(half, TAG_DIGEST)
    client.log_metric(half, "pretrain/train/loss", 99.0, step=7)
    client.update_run(half, "RUNNING")

    marker = finished.ledger.store / "sweeps" / finished.description.id / "tracked.json"
    marker.unlink()
    project_sweep(*given)
    after = snapshot(client, tracked.experiment_id)
    assert after["all-seed0"][0] != half
    assert {name: seen[1:] for name, seen in after.items()} == {
        name: seen[1:] for name, seen in before.items()
    }


def test_a_cell_that_is_repaired_becomes_finished(finished, monkeypatch):
    tracked = project_sweep(finished.ledger, finished.id)
    monkeypatch.setattr(fake_science, "finetune", lambda ctx: fake_science._learn(ctx, "finetune"))
    again = type(finished)(finished.ledger.store.parent)
    project_sweep(again.ledger, again.id)
    parents, children = runs(MlflowClient(tracked.uri), tracked.experiment_id)
    assert parents[0].info.status == "FINISHED"
    assert {run.info.status for run in children.values()} == {"FINISHED"}
    assert "dmfc.failure" not in children["broken-seed0"].data.tags


def test_long_parameters_are_cut_and_kept_whole_in_the_config(finished):
    finished.description.cells[0].config["objects"]["train"] = ["procedural:cup-0001"] * 50
    finished.description.save(finished.folder)
    tracked = project_sweep(finished.ledger, finished.id)
    client = MlflowClient(tracked.uri)
    _, children = runs(client, tracked.experiment_id)
    run = children["pretrained-seed0"]
    assert len(run.data.params["objects.train"]) == 250
    path = Path(client.download_artifacts(run.info.run_id, "config.yaml"))
    assert path.read_text().count("procedural:cup-0001") == 50


def test_a_damaged_metrics_file_is_one_line(finished):
    address = finished.description.cells[0].model
    (finished.ledger.folder(address) / "metrics.jsonl").write_text('{"epoch": 0')
    with pytest.raises(DmfcError, match="cannot be read"):
        project_sweep(finished.ledger, finished.id)


def test_a_run_that_lacks_steps_is_completed_in_its_place(finished):
    tracked = project_sweep(finished.ledger, finished.id)
    client = MlflowClient(tracked.uri)
    before = snapshot(client, tracked.experiment_id)
    address = finished.description.cells[1].model
    metrics = finished.ledger.folder(address) / "metrics.jsonl"
    line = json.loads(metrics.read_text().splitlines()[0])
    with metrics.open("a") as out:
        for epoch in (1, 2):
            out.write(json.dumps(line | {"epoch": epoch, "loss": 0.1}) + "\n")
    project_sweep(finished.ledger, finished.id)
    after = snapshot(client, tracked.experiment_id)
    assert after["all-seed0"][0] == before["all-seed0"][0]
    history = after["all-seed0"][6]["finetune/train/loss"]
    assert [(step, value) for step, value, _ in history] == [(0, 1.0), (1, 0.1), (2, 0.1)]


def test_a_rebuilt_database_has_equal_content(finished, tmp_path):
    tracked = project_sweep(finished.ledger, finished.id)
    with pytest.raises(DmfcError, match="has runs already"):
        rebuild(finished.ledger, [finished.id])
    uri = f"sqlite:///{tmp_path / 'new' / 'mlflow.db'}"
    (tmp_path / "new").mkdir()
    shutil.copy(finished.empty, tmp_path / "new" / "mlflow.db")
    (again,) = rebuild(finished.ledger, [finished.id], uri)

    assert comparable(again) == comparable(tracked)


@pytest.mark.full
def test_a_server_by_its_uri_has_equal_content(finished, tmp_path, capsys):
    tracked = project_sweep(finished.ledger, finished.id)
    (tmp_path / "server").mkdir()
    shutil.copy(finished.empty, tmp_path / "server" / "mlflow.db")
    with serve(finished.ledger, 0, f"sqlite:///{tmp_path / 'server' / 'mlflow.db'}") as address:
        again = project_sweep(finished.ledger, finished.id, address)
        assert again.uri == address
        assert comparable(again) == comparable(tracked)
    assert capsys.readouterr().out == ""
    with pytest.raises(DmfcError, match="no MLflow server answers"):
        rebuild(finished.ledger, [finished.id], address)


def test_data_code_and_machine_are_told(finished):
    tracked = project_sweep(finished.ledger, finished.id)
    client = MlflowClient(tracked.uri)
    parents, children = runs(client, tracked.experiment_id)
    inputs = {
        item.tags[0].value: item.dataset for item in children["all-seed0"].inputs.dataset_inputs
    }
    assert inputs["training"].name == inputs["testing"].name == "single scenes"
    assert inputs["training"].digest != inputs["testing"].digest
    assert set(json.loads(inputs["training"].source)["stages"]) == {
        address for address in finished.ledger.addresses("scenes")
    } - set(json.loads(inputs["testing"].source)["stages"])
    other = {
        item.tags[0].value: item.dataset
        for item in children["pretrained-seed0"].inputs.dataset_inputs
    }
    assert other["training"].digest == inputs["training"].digest
    assert parents[0].data.tags["dmfc.commits"] == parents[0].data.tags["mlflow.source.git.commit"]
    assert "torch" in parents[0].data.tags["dmfc.versions"]
    provenance = json.loads(
        Path(client.download_artifacts(tracked.run_id, "provenance.json")).read_text()
    )
    (call,) = provenance["calls"]
    assert call["flags"]
    assert call["packages"]["mlflow"]


def test_the_best_model_is_registered_once(finished):
    write_state(finished.folder, "FINISHED", {})
    tracked = project_sweep(finished.ledger, finished.id)
    (finished.folder / "tracked.json").unlink()
    project_sweep(finished.ledger, finished.id)
    client = MlflowClient(tracked.uri)
    (version,) = client.search_model_versions("name = 'dmfc-tiny'")
    best = client.get_model_version_by_alias("dmfc-tiny", "best")
    assert best.version == version.version
    assert version.tags["dmfc.cell"] in ("pretrained", "all")
    assert finished.ledger.finished(version.tags["dmfc.model_stage"])
    files = {entry.path for entry in client.list_artifacts(version.run_id, "model")}
    assert "model/weights" in files


def test_live_status_and_steps_then_death_then_the_end(finished):
    """A driver at work, killed, and one that ends it: one run, right each time, no step twice."""
    ledger, cell = finished.ledger, finished.description.cells[1]
    address, work = cell.model, finished.ledger.work(cell.model)
    whole = finished.ledger.folder(address)
    away = finished.folder / "away"
    evaluations = [ledger.folder(item) for item in cell.evaluations]
    moved = [(folder, folder.with_name(f"away-{folder.name}")) for folder in evaluations]
    for folder, place in [(whole, away), *moved]:
        folder.rename(place)
    work.mkdir(parents=True)
    first, *_ = (away / "metrics.jsonl").read_text().splitlines(keepends=True)

    def seen():
        tracked = project_sweep(ledger, finished.id)
        client = MlflowClient(tracked.uri)
        found = snapshot(client, tracked.experiment_id)
        return found, found[finished.id][1]

    with driving([finished.folder]):
        write_state(finished.folder, "RUNNING", {})
        found, parent = seen()
        assert (found["all-seed0"][1], parent) == ("RUNNING", "RUNNING")  # pre-training is there
        assert found["pretrained-seed0"][1] == "FINISHED"
        tell_attempt(work, "x", datetime.now(UTC))
        (work / "metrics.jsonl").write_text(first + '{"epoch": 1, "st')
        (work / "system.jsonl").write_text('{"time": 1.5, "cpu_utilization_percentage": 99.0}\n')
        found, _ = seen()
        run_id = found["all-seed0"][0]
        assert found["all-seed0"][1] == "RUNNING"
        assert [step for step, *_ in found["all-seed0"][6]["finetune/train/loss"]] == [0]
        assert found["all-seed0"][6]["system/cpu_utilization_percentage"] == [(0, 99.0, 1500)]
        assert found["all-seed0"][5]["dmfc.progress"].startswith("finetune 0%")
        assert read_state(finished.folder).drivers
    assert read_state(finished.folder).status == "KILLED"
    assert project_stale(ledger) == [finished.id]
    found, parent = seen()
    assert (found["all-seed0"][1], parent) == ("KILLED", "KILLED")

    for folder, place in [(whole, away), *moved]:
        place.rename(folder)
    shutil.copy(work / "system.jsonl", whole)
    shutil.rmtree(work)
    write_state(finished.folder, "FINISHED", {})
    found, parent = seen()
    assert (found["all-seed0"][1], parent) == ("FINISHED", "FINISHED")
    assert found["all-seed0"][0] == run_id
    assert "dmfc.progress" not in found["all-seed0"][5]
    history = [(step, value) for step, value, _ in found["all-seed0"][6]["finetune/train/loss"]]
    assert len(history) == len({step for step, _ in history})
    assert project_stale(ledger) == []
