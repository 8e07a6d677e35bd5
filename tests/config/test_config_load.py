"""Settings: what a user writes becomes typed values, or one line that says what is wrong."""

import dataclasses

import pytest

from dmfc.config.load import all_keys, build_config, load_config
from dmfc.config.plain_yaml import parse_yaml
from dmfc.config.presets import preset_title
from dmfc.config.schema import Config
from dmfc.config.setting import help_of
from dmfc.config.shipped import shipped_names
from dmfc.errors import DmfcError


def message(function, *args) -> str:
    with pytest.raises(DmfcError) as caught:
        function(*args)
    text = str(caught.value)
    assert "\n" not in text
    return text


def test_defaults_are_those_of_the_schema():
    assert load_config() == Config()


def test_overrides_are_typed():
    config = load_config(
        None,
        [
            "training.pretrain.epochs=012",
            "network.radii=[1, 2e-2, .03]",
            "losses.weights.collision=2",
            "hand.name=yes",
            "objects.train=[procedural:24]",
        ],
    )
    assert config.training.pretrain.epochs == 12
    assert config.network.radii == [1.0, 0.02, 0.03]
    assert config.losses.weights.collision == 2.0
    assert isinstance(config.losses.weights.collision, float)
    assert config.hand.name == "yes"
    assert config.objects.train == ["procedural:24"]
    assert config.training.finetune == Config().training.finetune


def test_settings_are_frozen():
    with pytest.raises(dataclasses.FrozenInstanceError):
        load_config().training.batch_size = 3  # type: ignore[misc]


@pytest.mark.parametrize(
    ("override", "parts"),
    [
        ("training.batch_sise=4", ["training.batch_sise", "did you mean 'training.batch_size'"]),
        ("losses.colision=1", ["did you mean 'losses.weights.collision'"]),
        ("grasps.approach=0.2", ["'grasps.approach'", "now called 'grasps.pregrasp_distance'"]),
        ("scenes={clearance: 0}", ["now called 'scenes.approach_tolerance'"]),
        ("batch_size=4", ["did you mean 'training.batch_size'"]),
        ("losses.weights.friction_cone=1", ["unknown setting 'losses.weights.friction_cone'"]),
        ("training.batch_size=four", ["training.batch_size", "four", "Integer"]),
        ("training.batch_size=3.7", ["training.batch_size", "3.7"]),
        ("training.batch_size=true", ["training.batch_size"]),
        ("matching.mode=near", ["matching.mode", "patch", "projected", "literal"]),
        ("objects.train=ycb", ["objects.train", "wants a list", "ycb"]),
        ("losses.custom={a.py:b: much}", ["losses.custom.a.py:b", "much", "Float"]),
        ("losses.custom=[a]", ["--set losses.custom=[a]"]),
        ("training=3", ["'training' is a group"]),
        ("training.batch_size", ["key=value"]),
        ("hand.name=${nothing}", ["hand.name", "nothing"]),
        ("hand.name=[1", ["not valid YAML"]),
    ],
)
def test_what_is_wrong_is_said_on_one_line(override, parts):
    text = message(load_config, None, [override])
    for part in parts:
        assert part in text


def test_unknown_preset_names_the_nearest():
    assert "did you mean 'quick'" in message(load_config, "quik")
    assert "does not exist" in message(load_config, "nowhere/mine.yaml")


def test_a_users_own_preset_by_path(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text("training:\n  pretrain: {epochs: 3}\ntraining.batch_size: 2\n")
    config = load_config(str(path))
    assert config.training.pretrain.epochs == 3
    assert config.training.batch_size == 2
    path.write_text("training: {epoch: 3}\n")
    assert "training.epoch" in message(load_config, str(path))
    path.write_text("training: {seed: 1}\ntraining: {seed: 2}\n")
    assert "'training' is given twice, on lines 1 and 2" in message(load_config, str(path))
    path.write_text("- a\n")
    assert "not a mapping" in message(load_config, str(path))


def test_one_setting_under_two_spellings_is_an_error():
    values = {"training": {"seed": 1}, "training.seed": 2}
    assert "'training.seed' is given twice" in message(build_config, [("here", values)])


def test_every_shipped_preset_loads():
    names = shipped_names("configs")
    assert {"smoke", "quick", "medium", "full", "literal"} == set(names)
    for name in names:
        assert isinstance(load_config(name), Config)


@pytest.mark.parametrize(("old", "new"), [("paper", "full"), ("hour", "medium")])
def test_a_former_name_is_refused_with_the_new_one(old, new):
    assert f"preset '{old}' is now called '{new}'" in message(load_config, old)


def test_several_presets_lie_over_each_other_in_order():
    config = load_config(["quick", "literal"])
    assert (config.scenes.train.count, config.training.pretrain.epochs) == (96, 40)
    assert (config.network.offset_to, config.training.finetune.learning_rate) == ("origin", 1e-3)
    assert load_config(["literal", "quick"]).training.finetune.learning_rate == 3e-5
    assert preset_title(["quick", "literal"]) == "quick+literal"


def test_the_literal_preset_is_the_paper_as_printed():
    """Figures of the article's section on training, and of its inference."""
    config = load_config(["full", "literal"])
    schedules = (config.training.pretrain, config.training.finetune)
    assert [stage.epochs for stage in schedules] == [50, 20]
    for stage in schedules:
        assert (stage.learning_rate, stage.decay, stage.decay_every) == (1e-3, 0.9, 10)
    assert config.network.neighbours == [32, 64, 64]
    assert (config.execution.min_confidence, config.execution.most_confident) == (0.15, 0)
    assert (config.training.hard_samples, config.training.hard_stages) == (64, "both")


def test_presets_of_sizes_leave_what_works_alone():
    """What the paper leaves open is a default, which no size changes."""
    groups = ("network", "losses", "matching", "physics", "closing", "execution", "validation")
    for name in ("quick", "medium", "full"):
        config = load_config(name)
        for group in groups:
            assert getattr(config, group) == getattr(Config(), group), (name, group)


def test_a_preset_extends_others(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text("extends: [quick, literal]\nscenes.train.count: 7\n")
    config = load_config(str(path))
    assert config.scenes.train.count == 7
    assert config.scenes.test.count == load_config("quick").scenes.test.count
    assert config.network.offset_to == "origin"
    path.write_text(f"extends: {path}\n")
    assert "extends itself" in message(load_config, str(path))
    path.write_text("extends: quik\n")
    assert "did you mean 'quick'" in message(load_config, str(path))
    path.write_text("extends: {a: 1}\n")
    assert "extends wants" in message(load_config, str(path))


def test_the_full_preset_has_the_papers_figures():
    config = load_config("full")
    assert (config.training.pretrain.epochs, config.training.finetune.epochs) == (50, 20)
    assert (config.scenes.train.count, config.scenes.test.count) == (1000, 100)
    assert (config.scenes.points, config.hand.collision_points) == (2048, 2000)
    assert config.training.hard_samples == 64
    assert config.execution.grasps_per_scene == 4
    assert config.execution.min_confidence == 0.15
    assert config.objects.train == ["household", "random:485"]
    assert config.objects.max_train == 0


def test_every_setting_has_help():
    for key, group in all_keys().items():
        owner = Config if "." not in key else all_keys()[key.rpartition(".")[0]]
        assert owner is not None
        assert help_of(owner)[key.rpartition(".")[2]], key
        assert group is None or dataclasses.is_dataclass(group)


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("yes", "yes"),
        ("012", "012"),
        ("0", 0),
        ("-3", -3),
        ("1e-3", 1e-3),
        ("1.5", 1.5),
        ("1:30", "1:30"),
        ("2024-01-01", "2024-01-01"),
        ("true", True),
        ("null", None),
        ("", None),
        ("off", "off"),
        ("0x1f", "0x1f"),
    ],
)
def test_scalars_are_read_as_people_do(text, value):
    got = parse_yaml(f"key: {text}", "here")["key"]
    assert got == value
    assert type(got) is type(value)
