"""What a predictor's stages depend on, and what is refused."""

from __future__ import annotations

import json
from collections import Counter
from pathlib import Path

import pytest

from dmfc.config.load import load_config
from dmfc.engine.stage import closure
from dmfc.errors import DmfcError
from dmfc.pipeline.graph import GraphBuilder
from dmfc.pipeline.graph_outcome import outcome
from dmfc.prediction.models import model_folder
from tests.support.fake_science import fake_refs

SCORED = ("execution.score=outcome", "outcome.judge=train", "outcome.objects=[a]")


@pytest.fixture
def builder() -> GraphBuilder:
    return GraphBuilder(fake_refs)


def stages(builder: GraphBuilder, *overrides: str, model: str = "pretrained") -> dict[str, set]:
    config = load_config("smoke", [*SCORED, *overrides])
    kinds: dict[str, set] = {}
    for stage in closure(builder.cell(config, model, "c").evaluations):
        kinds.setdefault(stage.kind, set()).add(stage.key)
    return kinds


def test_an_object_is_a_stage_of_rollouts_whatever_others_there_are(builder: GraphBuilder) -> None:
    few, more = stages(builder), stages(builder, "outcome.objects=[a, b]")
    assert len(few["rollouts"]) == 2
    assert len(more["rollouts"]) == 4
    assert few["rollouts"] < more["rollouts"]
    assert few["outcome"] != more["outcome"]
    assert few["pretrain"] == more["pretrain"]


@pytest.mark.parametrize(
    ("override", "changed"),
    [
        ("outcome.epochs=3", {"outcome", "evaluate"}),
        ("outcome.widths=[]", {"outcome", "evaluate"}),
        ("outcome.rollouts.uniform=9", {"rollouts", "outcome", "evaluate"}),
        ("outcome.rollouts.hold_time=2", {"rollouts", "outcome", "evaluate"}),
        ("physics.hand_friction=0.7", None),
        ("execution.most_confident=8", {"evaluate"}),
        ("execution.cloud_check=true", {"evaluate"}),
        ("execution.cloud_margin=0.002", {"evaluate"}),
        ("execution.grasps_per_scene=2", {"evaluate"}),
        ("execution.approach_tolerance=0.002", {"rollouts", "outcome", "evaluate"}),
        ("run.rollouts.cpus=2", set()),
    ],
)
def test_a_setting_reruns_what_depends_on_it(
    builder: GraphBuilder, override: str, changed: set[str] | None
) -> None:
    before, after = stages(builder), stages(builder, override)
    different = {kind for kind in before if before[kind] != after[kind]}
    if changed is None:  # labels are planned under the same physics
        assert {"grasps", "rollouts", "outcome", "evaluate"} <= different
    else:
        assert different == changed


def test_trials_of_labels_depend_on_no_model(builder: GraphBuilder) -> None:
    labels = "outcome.rollouts.source=labels"
    found = stages(builder, labels)
    assert found["rollouts"].isdisjoint(stages(builder)["rollouts"])
    other = stages(builder, labels, "training.seed=5")
    assert found["pretrain"].isdisjoint(other["pretrain"])
    assert found["rollouts"] == other["rollouts"]
    planned = stages(builder, labels, "grasps.per_object=7")
    assert found["rollouts"].isdisjoint(planned["rollouts"])


def test_a_retrained_head_depends_on_the_model(builder: GraphBuilder) -> None:
    head = "outcome.form=head"
    found, features = stages(builder, head), stages(builder)
    assert found["rollouts"] == features["rollouts"]
    assert found["outcome"] != features["outcome"]


def test_clutter_adds_shards_of_scenes_of_all_objects(builder: GraphBuilder) -> None:
    alone = stages(builder)
    both = stages(builder, "outcome.rollouts.clutter=5", "outcome.rollouts.shards=3")
    assert len(both["rollouts"] - alone["rollouts"]) == 3
    assert alone["rollouts"] < both["rollouts"]


def test_a_predictor_must_not_have_seen_what_it_is_tested_on(builder: GraphBuilder) -> None:
    tested = load_config("smoke").objects.test[0]
    with pytest.raises(DmfcError, match="must not have seen what it is tested on"):
        stages(builder, f"outcome.objects=[{tested}]")


def test_rows_without_a_model_name_the_proposer(builder: GraphBuilder) -> None:
    with pytest.raises(DmfcError, match=r"outcome\.proposer"):
        stages(builder, model="random")
    found = stages(builder, "outcome.proposer=table1-pretrained", model="random")
    assert "pretrain" not in found
    config = load_config("smoke", [*SCORED, "outcome.proposer=table1-pretrained"])
    made = outcome(builder, config, model_folder("table1-pretrained"))
    assert found["outcome"] == {made.key}


def test_a_finished_predictor_is_known_by_what_is_in_its_file(
    builder: GraphBuilder, tmp_path: Path
) -> None:
    file = tmp_path / "outcome.safetensors"
    file.write_bytes(b"one")
    judged = f"outcome.judge={tmp_path}"
    one = stages(builder, judged)
    assert "outcome" not in one
    assert stages(builder, judged) == one
    file.write_bytes(b"two")
    two = stages(builder, judged)
    assert one["evaluate"] != two["evaluate"]
    tested = fake_refs(load_config("smoke").objects.test)[0].id
    (tmp_path / "outcome.json").write_text(json.dumps({"objects": ["x/1", tested]}))
    with pytest.raises(DmfcError, match=f"learned from '{tested}', which is in objects.test"):
        stages(builder, judged)
    file.unlink()
    with pytest.raises(DmfcError, match=r"outcome\.judge: there is no outcome\.safetensors"):
        stages(builder, judged)


def test_the_threshold_in_units_of_w5_is_the_same_rule_for_every_w5(builder: GraphBuilder) -> None:
    def least(*overrides: str) -> float:
        config = load_config("smoke", list(overrides))
        (first, *_) = builder.cell(config, "planner", "c").evaluations
        return first.config["execution"].min_confidence

    assert least() == 0.15
    assert least("losses.weights.confidence=0.2") == 0.15
    relative = "execution.confidence_unit=weight"
    assert least(relative, "losses.weights.confidence=0.2") == pytest.approx(0.03)
    assert least(relative, "losses.weights.confidence=1") == pytest.approx(0.15)


def test_table_three_has_one_set_of_rollouts_for_all_rows_but_the_one_off_policy(
    builder: GraphBuilder,
) -> None:
    from dmfc.sweep.planner import plan_sweep
    from dmfc.sweep.sweep_file import load_sweep

    plan = plan_sweep(load_sweep("outcome"), builder, "smoke")
    counts = Counter(stage.kind for stage in closure(plan.targets))
    assert counts["outcome"] == 4  # logistic regression, head, network, network off-policy
    assert counts["rollouts"] == 8  # two objects of each of two selectors, twice
    assert counts["pretrain"] == 0
