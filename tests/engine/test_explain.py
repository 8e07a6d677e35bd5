"""What a dry run says of a stage that is not there."""

import dataclasses

import pytest

from dmfc.config.load import load_config
from dmfc.engine.engine import run_stages
from dmfc.engine.explain import reasons
from dmfc.engine.stage import closure
from dmfc.pipeline.graph import GraphBuilder
from tests.support.fake_science import FAKES, fake_refs


def stages(*overrides, kinds=FAKES):
    """A fine-tuned cell's stages under the smoke preset."""
    builder = GraphBuilder(fake_refs, kinds)
    cell = builder.cell(load_config("smoke", list(overrides)), "finetuned", "c")
    return closure(cell.evaluations)


def why(ledger, *overrides, kinds=FAKES):
    """The reasons by kind of stage."""
    wanted = stages(*overrides, kinds=kinds)
    told = reasons(wanted, ledger, kinds)
    found: dict[str, set] = {}
    for stage in wanted:
        if stage.address in told:
            found.setdefault(stage.kind, set()).add(told[stage.address])
    return found


@pytest.fixture
def done(ledger, config):
    run_stages(stages(), ledger, config, kinds=FAKES, local=True)
    return ledger


def test_an_empty_store_has_made_nothing(ledger):
    assert set().union(*why(ledger).values()) == {"never made"}


def test_nothing_is_said_of_what_is_there(done):
    assert why(done) == {}


def test_a_changed_weight_names_itself_and_then_the_stage_that_follows(done):
    told = why(done, "losses.weights.collision=2")
    assert told == {
        "finetune": {"losses.weights.collision 1.0 -> 2.0"},
        "evaluate": {"its inputs are made again: finetune c seed 0"},
    }


def test_the_nearest_stage_is_compared_with(done, config):
    near = stages("losses.weights.collision=2")
    run_stages(near, done, config, kinds=FAKES, local=True)
    told = why(done, "losses.weights.collision=2", "losses.weights.q1_upper=3")
    assert told["finetune"] == {"losses.weights.q1_upper 0.0 -> 3.0"}


def test_many_changes_are_counted(done):
    weights = [f"losses.weights.{name}=9" for name in ("chamfer", "collision", "guidance")]
    (text,) = why(done, *weights, "losses.weights.q1_upper=9", "training.seed=5")["finetune"]
    assert text.endswith("; and 2 more")


def test_an_object_is_not_another_object_with_other_settings(done):
    """What tells two stages of a kind apart is said by the kind; the engine has no word for it."""
    nameless = {name: dataclasses.replace(kind, identity=()) for name, kind in FAKES.items()}
    told = why(done, "objects.train=[procedural/new]", kinds=nameless)
    assert any("-> procedural/new/0" in text for text in told["object"])


def test_new_code_and_new_objects_are_told(done):
    newer = FAKES | {"hand": dataclasses.replace(FAKES["hand"], version=99)}
    version = FAKES["hand"].version
    assert why(done, kinds=newer)["hand"] == {f"code version {version} -> 99"}
    told = why(done, "objects.train=[procedural/new]")
    assert told["object"] == {"never made"}
    assert any("object procedural/new/0" in text for text in told["grasps"])
