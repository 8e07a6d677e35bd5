"""What depends on which settings: cells that differ in fine-tuning alone share all the rest."""

from collections import Counter

import pytest

from dmfc.config.custom_function import custom_function
from dmfc.config.load import load_config
from dmfc.engine.stage import closure
from dmfc.errors import DmfcError
from dmfc.files.digest import file_digest
from dmfc.grasps.library import library_file
from dmfc.pipeline.graph import GraphBuilder, without
from dmfc.pipeline.graph_data import ObjectRef
from dmfc.pipeline.here import check_custom_backbone, check_custom_losses
from dmfc.prediction.models import model_folder
from dmfc.sweep.planner import plan_sweep
from dmfc.sweep.sweep_file import load_sweep
from tests.support.fake_science import fake_refs


@pytest.fixture
def builder():
    return GraphBuilder(fake_refs)


def by_kind(stages):
    kinds: dict[str, set] = {}
    for stage in closure(stages):
        kinds.setdefault(stage.kind, set()).add(stage.key)
    return kinds


def changed(builder, *overrides):
    """Kinds of stages whose keys change with a setting."""
    before, after = (
        by_kind(builder.cell(load_config("smoke", given), "finetuned", "c").evaluations)
        for given in ([], list(overrides))
    )
    return {kind for kind in before if before[kind] != after[kind]}


def test_table_one_shares_data_and_pretraining(builder):
    plan = plan_sweep(load_sweep("table1"), builder, "smoke")
    counts = Counter(stage.kind for stage in closure(plan.targets))
    shards = len(plan.cells[0].stages.evaluations)
    train_shards = counts["scenes"] - shards
    assert counts["pretrain"] == 1
    assert counts["finetune"] == 4
    assert counts["hand"] == 1
    assert counts["evaluate"] == 9 * shards
    assert counts["object"] == counts["grasps"] == 8
    assert train_shards == 2


@pytest.mark.parametrize(
    ("override", "kinds"),
    [
        ("losses.weights.collision=7", {"finetune", "evaluate"}),
        ("losses.q1.directions=728", {"finetune", "evaluate"}),
        ("losses.units.guidance=0.5", {"finetune", "evaluate"}),
        ("losses.grasp_space.length_unit=0.5", {"pretrain", "finetune", "evaluate"}),
        ("training.finetune.epochs=9", {"finetune", "evaluate"}),
        ("training.hard_samples=9", {"finetune", "evaluate"}),
        ("closing.squeeze=0.4", {"grasps", "scenes", "pretrain", "finetune", "evaluate"}),
        ("closing.opening=0.4", {"grasps", "scenes", "pretrain", "finetune", "evaluate"}),
        ("execution.changes={closing.squeeze: 0.4}", {"evaluate"}),
        ("training.pretrain.epochs=9", {"pretrain", "finetune", "evaluate"}),
        ("losses.weights.confidence=7", {"pretrain", "finetune", "evaluate"}),
        ("network.width=16", {"pretrain", "finetune", "evaluate"}),
        ("matching.distance=0.01", {"pretrain", "finetune", "evaluate"}),
        ("scenes.augmentation.noise=0.01", {"pretrain", "finetune", "evaluate"}),
        ("execution.min_confidence=0.5", {"evaluate"}),
        ("execution.protocol=dexgraspbench", {"evaluate"}),
        ("execution.changes={physics.timestep: 0.001}", {"evaluate"}),
        ("scenes.train.seed=5", {"scenes", "pretrain", "finetune", "evaluate"}),
        ("scenes.test.seed=5", {"scenes", "evaluate"}),
        ("grasps.per_object=7", {"grasps", "scenes", "pretrain", "finetune", "evaluate"}),
        (
            "objects.prepare.sdf_spacing=0.006",
            {"object", "grasps", "scenes", "pretrain", "finetune", "evaluate"},
        ),
        ("losses.weights.swept=1", {"finetune", "evaluate"}),
        ("losses.saturated=true", {"finetune", "evaluate"}),
        ("losses.swept.margin=0.001", {"finetune", "evaluate"}),
        ("training.finetune_form=projected", {"finetune", "evaluate"}),
        ("training.projection.steps=3", {"finetune", "evaluate"}),
        ("training.diagnostic_scenes=3", {"finetune", "evaluate"}),
        ("losses.custom={}", set()),
        ("grasps.library=''", set()),
        ("training.threads=4", set()),
        ("training.loader_workers=2", set()),
        ("run.cpus=1", set()),
        ("run.gpus_per_training=0.5", set()),
    ],
)
def test_a_setting_reruns_exactly_what_depends_on_it(builder, override, kinds):
    assert changed(builder, override) == kinds


def test_how_hard_samples_are_chosen_in_finetuning_leaves_pretraining_alone(builder):
    def kinds(*overrides):
        config = load_config("smoke", ["training.hard_stages=finetune", *overrides])
        return by_kind(builder.cell(config, "finetuned", "c").evaluations)

    usual = kinds()
    for override in (
        "training.hard_samples=9",
        "training.hard_scope=batch",
        "training.finetune_seeds=all",
    ):
        other = kinds(override)
        assert other["pretrain"] == usual["pretrain"]
        assert other["finetune"] != usual["finetune"]


def test_fine_tuning_knows_the_approach_where_it_is_swept_alone(builder):
    def finetuned(*overrides):
        return keys(builder, *overrides)["finetune"]

    for way in ("execution.waypoints=7", "execution.approach_tolerance=0.004"):
        assert finetuned(way) == finetuned()
        assert finetuned("losses.weights.swept=1", way) != finetuned("losses.weights.swept=1")
    lifted = "execution.lift_time=2"
    assert finetuned("losses.weights.swept=1", lifted) == finetuned("losses.weights.swept=1")


def test_fine_tuning_starts_from_a_model_that_is_there(builder, tmp_path):
    start = "training.finetune_from=table1-pretrained"
    stage = builder.finetune(load_config("smoke", [start]), "c")
    assert "weights" not in stage.inputs
    folder = model_folder("table1-pretrained")
    assert stage.hints["start"] == str(folder)
    assert stage.config["start"] == file_digest(folder / "weights.safetensors")
    assert "pretrain" not in keys(builder, start)
    # A copy elsewhere is the same start; other weights are another.
    copied = tmp_path / "mine"
    copied.mkdir()
    weights = copied / "weights.safetensors"
    weights.write_bytes((folder / weights.name).read_bytes())
    assert keys(builder, f"training.finetune_from={copied}") == keys(builder, start)
    weights.write_bytes(b"other")
    assert keys(builder, f"training.finetune_from={copied}")["finetune"] != {stage.key}
    with pytest.raises(DmfcError, match="did you mean 'table1-pretrained'"):
        keys(builder, "training.finetune_from=table1-pretrain")


def keys(builder, *overrides):
    return by_kind(builder.cell(load_config("smoke", overrides), "finetuned", "c").evaluations)


def test_a_loss_of_the_users_own_reruns_what_learns_with_it_whenever_its_file_changes(
    builder, tmp_path
):
    file = tmp_path / "mine.py"
    file.write_text("def high(hands):\n    return hands.position[:, 2]\n")
    override = f"losses.custom={{{file}:high: 1}}"
    assert changed(builder, override) == {"finetune", "evaluate"}
    before = keys(builder, override)
    file.write_text("def high(hands):\n    return -hands.position[:, 2]\n")
    after = keys(builder, override)
    assert {kind for kind in before if before[kind] != after[kind]} == {"finetune", "evaluate"}
    with pytest.raises(DmfcError, match=r"unknown function of .* 'hihg'; did you mean 'high'"):
        keys(builder, f"losses.custom={{{file}:hihg: 1}}")


def test_a_loss_that_changed_after_the_sweep_began_is_refused(tmp_path):
    file = tmp_path / "mine.py"
    file.write_text("def high(hands): ...\n")
    digest = custom_function(f"{file}:high", "losses.custom").digest
    check_custom_losses({f"{file}:high": digest})
    file.write_text("def high(hands): return 1\n")
    with pytest.raises(DmfcError, match="is not the same"):
        check_custom_losses({f"{file}:high": digest})


def test_a_hand_of_the_users_own_reruns_all_that_has_a_hand_whenever_its_files_change(
    builder, tmp_path
):
    mjcf = tmp_path / "hand.xml"
    mjcf.write_text('<mujoco><compiler meshdir="parts"/><mesh file="palm.stl"/></mujoco>')
    (tmp_path / "hand.yaml").write_text("name: mine\nmjcf: hand.xml\npalm: palm\n")
    (tmp_path / "parts").mkdir()
    mesh = tmp_path / "parts" / "palm.stl"
    mesh.write_text("one")
    override = f"hand.name={tmp_path / 'hand.yaml'}"
    with_hand = {"hand", "grasps", "scenes", "pretrain", "finetune", "evaluate"}
    for change in (
        lambda: mesh.write_text("two"),
        lambda: mjcf.write_text(mjcf.read_text() + " "),
        lambda: (tmp_path / "hand.yaml").write_text("name: ours\nmjcf: hand.xml\npalm: palm\n"),
    ):
        before = keys(builder, override)
        assert keys(builder, override) == before
        change()
        after = keys(builder, override)
        assert {kind for kind in before if before[kind] != after[kind]} == with_hand


def test_validation_is_its_own_objects_and_touches_training_alone(builder):
    config = load_config("smoke", ["validation.objects=[procedural/cup-0009]"])
    stages = closure(builder.cell(config, "finetuned", "c").evaluations)
    assert sum(stage.kind == "object" for stage in stages) == 10
    assert changed(builder, "validation.objects=[procedural/cup-0009]", "validation.every=2") == {
        "object",
        "grasps",
        "scenes",
        "pretrain",
        "finetune",
        "evaluate",
    }
    assert changed(builder, "validation.every=2") == set()
    for held_out in (config.objects.train, config.objects.test):
        shared = load_config("smoke", [f"validation.objects=[{held_out[0]}]"])
        with pytest.raises(DmfcError, match="objects of its own"):
            builder.pretrain(shared)


def test_more_test_scenes_keep_the_shards_there_are(builder):
    few = builder.scenes(load_config("smoke", ["scenes.test.count=4"]), "test")
    more = builder.scenes(load_config("smoke", ["scenes.test.count=8"]), "test")
    assert [stage.key for stage in few] == [stage.key for stage in more[: len(few)]]


def test_one_model_under_two_names_is_one_stage(builder):
    config = load_config("smoke")
    one, two = (builder.cell(config, "finetuned", name) for name in ("one", "two"))
    assert [s.key for s in one.evaluations] == [s.key for s in two.evaluations]


def test_a_seed_is_a_model_of_its_own_on_the_same_data(builder):
    one, two = (
        by_kind(
            builder.cell(
                load_config("smoke", [f"training.seed={seed}"]), "pretrained", "c"
            ).evaluations
        )
        for seed in (0, 1)
    )
    assert {kind for kind in one if one[kind] != two[kind]} == {"pretrain", "evaluate"}


def test_test_objects_are_never_trained_on(builder):
    config = load_config("smoke", ["objects.train=[a, b]", "objects.test=[b]"])
    with pytest.raises(DmfcError, match=r"'b/0' is in objects\.train and in objects\.test"):
        builder.cell(config, "pretrained", "c")


def test_an_empty_object_list_is_an_error(builder):
    for split in ("train", "test"):
        config = load_config("smoke", [f"objects.{split}=[]"])
        with pytest.raises(DmfcError, match=rf"objects\.{split} selects no object"):
            builder.cell(config, "pretrained", "c")


def test_a_scene_set_in_too_many_shards_is_an_error(builder):
    config = load_config("smoke", ["scenes.test.count=9000", "scenes.shard_size=1"])
    with pytest.raises(DmfcError, match=r"scenes\.test\.count 9,000 in shards of 1 makes 9,000"):
        builder.cell(config, "pretrained", "c")


def test_without_puts_defaults_back():
    config = load_config(None, ["training.finetune.epochs=3", "training.batch_size=9"])
    masked = without(config.training, "finetune")
    assert masked.finetune.epochs == 20
    assert masked.batch_size == 9
    with pytest.raises(ValueError, match="lacks"):
        without(config.training, "no_such_field")


def test_either_plans_what_the_library_lacks_and_nothing_else():
    refs = [ObjectRef("procedural/can-0005", "d"), ObjectRef("procedural/can-9005", "d")]
    builder = GraphBuilder(lambda selectors: refs)
    planned = builder.grasps(load_config("smoke", []), "train")
    taken, missing = builder.grasps(load_config("smoke", ["grasps.source=either"]), "train")
    assert taken.config["library"] == file_digest(library_file("shadow", "procedural/can-0005"))
    assert missing.key == planned[1].key
    with pytest.raises(DmfcError, match=r"can-9005.* set grasps\.source=either"):
        builder.grasps(load_config("smoke", ["grasps.source=library"]), "train")


def test_a_library_of_the_users_own_stands_in_for_the_packages(tmp_path):
    refs = [ObjectRef("procedural/can-0005", "d"), ObjectRef("own/ring", "d")]
    builder = GraphBuilder(lambda selectors: refs)
    file = tmp_path / "shadow" / "own__ring.parquet"
    file.parent.mkdir()
    file.write_bytes(b"grasps")
    mine = ["grasps.source=either", f"grasps.library={tmp_path}"]
    planned, taken = builder.grasps(load_config("smoke", mine), "train")
    assert taken.config["library"] == file_digest(file)
    assert taken.hints["file"] == str(file)
    assert planned.key == builder.grasps(load_config("smoke", []), "train")[0].key
    with pytest.raises(DmfcError, match=r"grasps\.library: .*nowhere is not a folder"):
        builder.grasps(load_config("smoke", ["grasps.library=nowhere"]), "train")


def kinds_of(builder, model, *overrides):
    config = load_config("smoke", list(overrides))
    return Counter(stage.kind for stage in closure(builder.cell(config, model, "c").evaluations))


def test_grasps_of_test_objects_are_planned_for_the_planner_alone(builder):
    """`dmfc evaluate MODEL` on the user's own objects plans nothing that it does not execute."""
    tested = "objects.test=[own]"
    assert kinds_of(builder, "random", tested)["grasps"] == 0
    assert kinds_of(builder, "planner", tested)["grasps"] == 2
    config = load_config("smoke", ["objects.train=[known]", tested])
    trained = closure(builder.cell(config, "finetuned", "c").evaluations)
    assert {s.name for s in trained if s.kind == "grasps"} == {"known/0", "known/1"}


def test_the_planner_and_the_others_have_one_set_of_test_scenes(builder):
    config = load_config("smoke", ["objects.test=[own]"])
    keys = [
        [
            stage.key
            for stage in closure(builder.cell(config, model, "c").evaluations)
            if stage.kind == "scenes" and stage.name.startswith("test")
        ]
        for model in ("planner", "random", "finetuned")
    ]
    assert keys[0] == keys[1] == keys[2] != []


def test_labels_of_the_library_stay_with_the_scenes():
    """They cost no planning, and results that are there keep their keys."""
    refs = [ObjectRef("ycb/mug"), ObjectRef("ycb/banana")]
    builder = GraphBuilder(lambda selectors: refs)
    config = load_config("smoke", ["objects.test=[ycb]", "grasps.source=library"])
    for model in ("planner", "random"):
        (shard, *_) = [
            stage
            for stage in closure(builder.cell(config, model, "c").evaluations)
            if stage.kind == "scenes"
        ]
        assert [stage.name for stage in shard.inputs["grasps"]] == ["ycb/mug", "ycb/banana"]
        evaluation = builder.cell(config, model, "c").evaluations[0]
        assert "labels" not in evaluation.config


def test_the_file_of_a_backbone_is_part_of_what_is_trained(builder, tmp_path):
    """And of nothing before it; the name of the default leaves the keys as they were."""
    file = tmp_path / "net.py"
    file.write_text("class Mine: ...\n")
    override = f"network.backbone={file}:Mine"
    trained = {"pretrain", "finetune", "evaluate"}
    assert changed(builder, override) == trained
    before = keys(builder, override)
    digests = builder.pretrain(load_config("smoke", [override])).config["custom_backbone"]
    check_custom_backbone(digests)
    file.write_text("class Mine: ...\n\n")
    after = keys(builder, override)
    assert {kind for kind in before if before[kind] != after[kind]} == trained
    with pytest.raises(DmfcError, match="is not the same"):
        check_custom_backbone(digests)
    assert changed(builder, "network.backbone=pointnet2") == set()
    assert changed(builder, "network.backbone=dgcnn") == trained
    with pytest.raises(DmfcError, match=r"unknown class of .* 'Mne'; did you mean 'Mine'"):
        keys(builder, f"network.backbone={file}:Mne")
    judged = ["execution.score=outcome", "outcome.form=head", f"network.backbone={file}:Mine"]
    with pytest.raises(DmfcError, match="keeps no copy of a backbone"):
        builder.cell(load_config("smoke", judged), "pretrained", "x")
