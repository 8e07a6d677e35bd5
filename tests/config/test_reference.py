"""The settings as `dmfc config` and the reference page show them."""

from __future__ import annotations

from pathlib import Path

import pytest

from dmfc.cli.reference import pages
from dmfc.config.load import all_keys, load_config, value_of
from dmfc.config.reference import as_text, described, shown
from dmfc.config.schema import Config
from dmfc.errors import DmfcError

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize("name", ["cli.md", "settings.md"])
def test_a_generated_page_is_fresh(name: str) -> None:
    committed = (ROOT / "docs" / "reference" / name).read_text()
    assert committed == pages()[name], "run `make reference`"


def test_every_setting_is_on_the_page() -> None:
    page = (ROOT / "docs" / "reference" / "settings.md").read_text()
    sections = {part.partition("`")[0]: part for part in page.split("\n## `")[1:]}
    for key, group in all_keys().items():
        if group is None:
            owner, _, name = key.rpartition(".")
            assert f"\n| `{name}` | " in sections[owner], key


def test_what_a_preset_changes_fits_a_screen_and_is_right() -> None:
    rows = [row for row in described("quick") if row.changed]
    lines = list(as_text(rows, 80))
    assert len(lines) <= 24
    assert max(map(len, lines)) <= 100
    assert {row.key: row.value for row in rows} == {
        "objects.train": ["procedural:24"],
        "grasps.source": "library",
        "scenes.train.count": 96,
        "scenes.test.count": 16,
        "scenes.shard_size": 8,
        "training.pretrain.epochs": 40,
        "training.finetune.epochs": 4,
        "training.finetune.learning_rate": 3e-5,
    }


def test_values_defaults_and_sources() -> None:
    presets, overrides = ["medium", "literal"], ["scenes.test.count=7", "losses.custom={a.py:b: 2}"]
    config = load_config(presets, overrides)
    rows = {row.key: row for row in described(presets, overrides)}
    assert set(rows) == {key for key, group in all_keys().items() if group is None}
    for key, row in rows.items():
        assert row.value == value_of(config, key)
        assert row.default == value_of(Config(), key)
        assert row.source != "default" or not row.changed, key
    assert rows["scenes.test.count"].source == "--set"
    assert rows["scenes.train.count"].source == "preset medium"
    assert rows["grasps.source"].source == "preset quick"  # medium extends it
    assert rows["network.offset_to"].source == "preset literal"
    assert rows["losses.custom"].value == {"a.py:b": 2.0}


def test_a_key_or_a_group_is_selected() -> None:
    (row,) = described(selector="execution.hold_time")
    assert (row.default, row.unit, row.range) == (2.0, "s", "from 0 to 600 s")
    group = [row.key for row in described(selector="training.finetune")]
    assert group[0] == "training.finetune.epochs"
    assert len(group) == 4
    with pytest.raises(DmfcError, match=r"did you mean 'training\.finetune'"):
        described(selector="training.fintune")


@pytest.mark.parametrize(
    ("value", "text"), [(1e-3, "0.001"), (True, "true"), ("", '""'), ([1, 2], "[1, 2]"), ("a", "a")]
)
def test_values_as_they_are_written(value: object, text: str) -> None:
    assert shown(value) == text
