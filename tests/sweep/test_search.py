"""A search: what is suggested follows from results alone, and nothing is trained twice."""

import dataclasses
import json
import math
from statistics import mean

import pytest

from dmfc.config.shipped import shipped_file
from dmfc.engine.engine import run_stages
from dmfc.engine.ledger import Ledger
from dmfc.errors import DmfcError
from dmfc.experiment import drive as cli_drive
from dmfc.pipeline.graph import GraphBuilder
from dmfc.report.collect import table_of
from dmfc.sweep.planner import plan_sweep
from dmfc.sweep.search import Range, Search, suggest
from dmfc.sweep.sweep_file import load_sweep
from tests.support.fake_science import FAKES, fake_refs

TEXT = """
kind: search
name: weights
base: {validation.objects: [held], validation.scenes.count: 2}
cells:
  paper: {model: finetuned}
search:
  trials: 5
  parallel: 2
  objective: {coverage: 1, penetration_mm: -0.01}
  space:
    losses.weights.collision: {low: 0.001, high: 1000, log: true}
    losses.weights.guidance: [1, 13]
"""
SEARCH = Search(
    trials=40,
    space={"a": Range(1e-3, 1e3, log=True), "b": Range(0, 1), "c": (1, 2, "x")},
    objective={"coverage": 1},
)


@pytest.fixture
def search(tmp_path):
    """Plans the search in a ledger as a new process would."""
    path = tmp_path / "weights.yaml"
    path.write_text(TEXT)

    def plan(ledger, *settings):
        builder = GraphBuilder(fake_refs, FAKES)
        return plan_sweep(load_sweep(str(path)), builder, "smoke", settings, ledger)

    return plan


def one_round(plan, ledger):
    """Run the plan, and grow it; its outcomes and the next plan."""
    plan.write(ledger)
    outcomes = run_stages(plan.targets, ledger, plan.config, kinds=FAKES, local=True)
    failed = {address for address, outcome in outcomes.items() if not outcome.ok}
    return outcomes, plan.grow(failed)


def to_the_end(plan, ledger):
    """All rounds; the last plan and every stage that was run."""
    ran = []
    while plan is not None:
        last = plan
        outcomes, plan = one_round(plan, ledger)
        ran += [address for address, outcome in outcomes.items() if outcome.status == "ran"]
    return last, ran


def test_suggestions_follow_from_the_results_alone():
    told = [({"a": 10.0**k, "b": 0.5, "c": 1}, -abs(k)) for k in (-2, 0, 2)]
    told.append(({"a": 5.0, "b": 0.1, "c": "x"}, None))
    first = suggest(SEARCH, told, 3)
    assert first == suggest(SEARCH, told, 3)
    assert first != suggest(dataclasses.replace(SEARCH, seed=1), told, 3)
    assert first != suggest(SEARCH, told[:-1], 3)
    assert len({json.dumps(one) for one in first}) == 3
    for settings in first:
        assert list(settings) == ["a", "b", "c"]
        assert 1e-3 <= settings["a"] <= 1e3
        assert 0 <= settings["b"] <= 1
        assert settings["c"] in (1, 2, "x")
        assert settings["a"] == float(f"{settings['a']:.4g}")


def test_it_comes_near_the_optimum():
    """a = 1 is best; drawn evenly, the mean distance would be 1.5 decades."""
    told: list = []
    while len(told) < 40:
        for settings in suggest(SEARCH, told, 2):
            told.append((settings, -abs(math.log10(settings["a"]))))
    assert mean(-value for _, value in told[20:]) < 1.0


def test_what_fails_is_avoided():
    told: list = []
    while len(told) < 40:
        for settings in suggest(SEARCH, told, 2):
            told.append((settings, None if settings["c"] == "x" else settings["b"]))
    assert sum(value is None for _, value in told[20:]) <= 3


def test_a_search_trains_each_trial_once_and_executes_the_best(search, ledger):
    plan, ran = to_the_end(search(ledger), ledger)
    assert len(ran) == len(set(ran))
    assert set(ran) == set(ledger.addresses())
    trials = table_of(ledger, plan.record()).trials
    assert [trial.name for trial in trials] == [f"trial-{n:03d}" for n in range(5)]
    done = [trial for trial in trials if trial.value is not None]
    assert {trial.settings["losses.weights.guidance"] for trial in done} == {1}
    (best,) = (trial for trial in trials if trial.best)
    assert best.value == max(trial.value for trial in done)
    assert best.value == pytest.approx(
        best.measures["coverage"] - 0.01 * best.measures["penetration_mm"]
    )
    cells = {cell.cell.name: cell for cell in plan.cells}
    assert cells["best"].stages.model.key == cells[best.name].stages.model.key
    assert len(cells["best"].stages.evaluations) > 0
    assert cells[best.name].stages.evaluations == ()
    pretrained = {a for a in ran if a.startswith("pretrain/")}
    assert len(pretrained) == 1
    # Called again it tries what failed, and nothing else.
    failed = {c.stages.model.address for c in plan.cells if c.stages.model} - set(ran)
    plan_again = search(ledger)
    assert {s.address for s in plan_again.targets if not ledger.finished(s.address)} == failed
    again, ran_again = to_the_end(plan_again, ledger)
    assert ran_again == []
    assert again.search == plan.search


def test_a_killed_search_goes_on_to_the_same_trials(search, ledger, tmp_path):
    calm = Ledger(tmp_path / "calm")
    whole, _ = to_the_end(search(calm), calm)
    _, plan = one_round(search(ledger), ledger)
    plan.write(ledger)
    model = next(c.stages.model for c in plan.cells if c.cell.name == "trial-002")
    run_stages([model], ledger, plan.config, kinds=FAKES, local=True)  # and then a SIGKILL
    made = {address: ledger.record(address)["started"] for address in ledger.addresses()}
    resumed, _ = to_the_end(search(ledger), ledger)
    assert resumed.id == whole.id
    assert resumed.search == whole.search
    assert set(ledger.addresses()) == set(calm.addresses())
    assert all(ledger.record(address)["started"] == at for address, at in made.items())


def test_more_trials_go_on_and_another_space_begins_anew(search, ledger, tmp_path):
    first, _ = to_the_end(search(ledger), ledger)
    more, _ = to_the_end(search(ledger, "run.search_trials=7"), ledger)
    assert more.id == first.id
    assert more.search.trials[:5] == first.search.trials
    assert len(more.search.trials) == 7
    path = tmp_path / "weights.yaml"
    path.write_text(TEXT.replace("high: 1000", "high: 10"))
    assert search(ledger).id != first.id
    assert search(ledger, "training.batch_size=3").id != first.id


def test_a_search_in_the_terminal_in_files_and_in_mlflow(driven_search, capsys):
    from mlflow.tracking import MlflowClient

    from dmfc.tracking.store import tracking_uri

    plan, ledger = driven_search
    driven = cli_drive.drive([plan], ledger, as_json=False)
    out = capsys.readouterr().out
    assert driven.complete
    (result,) = driven.results
    assert len(result["search"]) == 5
    assert "best (trial" in out
    assert "Trials of the search" in out
    folder = plan.folder(ledger)
    assert len((folder / "search.csv").read_text().splitlines()) == 6
    page = (folder / "table.html").read_text()
    assert '<table id="search">' in page
    assert "the loss is not finite" in (folder / "table.md").read_text()
    client = MlflowClient(tracking_uri(ledger))
    (experiment,) = (e for e in client.search_experiments() if e.name == "dmfc")
    runs = {r.data.tags["dmfc.cell"]: r for r in client.search_runs([experiment.experiment_id])}
    trials = {name: runs[f"{name}-seed0"] for name in result["search"]}
    for name, told in result["search"].items():
        assert trials[name].data.metrics.get("objective") == told["value"]
        assert trials[name].info.status == ("FAILED" if told["failure"] else "FINISHED")
    assert {run.info.status for run in trials.values()} == {"FAILED", "FINISHED"}
    assert "overall" in runs["best-seed0"].data.metrics
    values = [told["value"] for told in result["search"].values() if told["value"] is not None]
    steps = client.get_metric_history(runs["-"].info.run_id, "search.objective")
    assert [metric.value for metric in sorted(steps, key=lambda m: m.step)] == values


@pytest.fixture
def driven_search(search, ledger, empty_database, monkeypatch):
    from dmfc.engine.pools import LocalPool
    from dmfc.pipeline.kinds import KINDS

    for name, fake in FAKES.items():
        monkeypatch.setitem(KINDS, name, fake)
    monkeypatch.setattr("dmfc.engine.engine.RayPool", LocalPool)
    (ledger.store / "mlflow").mkdir(parents=True)
    (ledger.store / "mlflow" / "mlflow.db").write_bytes(empty_database.read_bytes())
    return search(ledger), ledger


@pytest.mark.parametrize(
    ("old", "new", "part"),
    [
        ("kind: search\n", "", "'kind: search' and the key 'search' belong together"),
        ("kind: search\n", "kind: serach\n", "did you mean 'search'"),
        ("  trials: 5\n", "", "wants 'trials'"),
        ("trials: 5", "trials: 0", "trials wants a whole number from 1 to 100000, not 0"),
        ("coverage: 1", "covrage: 1", "did you mean 'coverage'"),
        ("{low: 0.001, high: 1000, log: true}", "{low: 0, high: 1, log: true}", "above 0"),
        ("{low: 0.001, high: 1000, log: true}", "3", "wants 'key: value' pairs"),
        ("{low: 0.001, high: 1000, log: true}", "{low: -1, high: 1}", "must be from 0 to 1000000"),
        ("{low: 0.001, high: 1000, log: true}", "{low: 0, high: inf}", "wants {low, high, log}"),
        ("{low: 0.001, high: 1000, log: true}", "[1, nan]", "must be a finite number"),
        ("losses.weights.collision:", "training.batch_size:", "batch_size: Value '0.001'"),
        ("coverage: 1", "coverage: nan", "wants a number"),
        ("losses.weights.collision:", "losses.weights.colision:", "losses.weights.collision"),
        ("[held]", "[]", "needs validation.objects"),
        ("  paper: {model", "  best: {model", "the cells that a search adds"),
    ],
)
def test_what_is_wrong_is_said_on_one_line(search, ledger, tmp_path, old, new, part):
    assert TEXT.count(old) == 1
    (tmp_path / "weights.yaml").write_text(TEXT.replace(old, new))
    with pytest.raises(DmfcError) as caught:
        search(ledger)
    assert part in str(caught.value)
    assert "\n" not in str(caught.value)


def test_the_shipped_search_is_over_all_five_weights(ledger):
    sweep = load_sweep(str(shipped_file("sweeps", "search", "sweep")))
    assert set(sweep.search.space) == {
        f"losses.weights.{name}"
        for name in ("chamfer", "collision", "guidance", "q1_upper", "confidence")
    }
    plan = plan_sweep(sweep, GraphBuilder(fake_refs, FAKES), "smoke", (), ledger)
    assert plan.search.wanted == 3
    assert len(plan.search.trials) == sweep.search.parallel
