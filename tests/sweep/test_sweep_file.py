"""Sweep files: what is shipped, and every way of getting one wrong."""

import dataclasses

import pytest

from dmfc.config.shipped import shipped_names
from dmfc.errors import DmfcError
from dmfc.pipeline.graph import GraphBuilder
from dmfc.sweep.planner import plan_sweep
from dmfc.sweep.sweep_file import cell_config, load_sweep, seeds_of, with_seeds
from tests.support.fake_science import FAKES, fake_refs

CELL = "cells:\n  a: {model: pretrained}\n"
A_LOT = list(range(500))
BOMB = "a: &a [x, x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"{name}: &{name} [{', '.join(10 * ['*' + before])}]\n"
    for before, name in zip("abcdefgh", "bcdefghi", strict=True)
)
"""Each of its names repeats the one before ten times: a thousand million values on ten lines."""


def resolve(path: str) -> None:
    """Read a sweep file and the settings of each of its cells."""
    sweep = load_sweep(path)
    for cell in sweep.cells:
        cell_config(sweep, cell, 0, "smoke", [])


def error(tmp_path, text) -> str:
    path = tmp_path / "my.yaml"
    path.write_text(text)
    with pytest.raises(DmfcError) as caught:
        resolve(str(path))
    assert "\n" not in str(caught.value)
    assert "my.yaml" in str(caught.value)
    return str(caught.value)


@pytest.mark.parametrize(
    ("text", "part"),
    [
        ("cells:\n  a: {}\n  a: {}\n", "'a' is given twice, on lines 2 and 3"),
        ("cells:\n- {name: a}\n- {name: a}\n", "two cells are named 'a'"),
        ("cells:\n- {model: pretrained}\n", "cell 1 has no name"),
        ("cells: {}\n", "no cells"),
        ("name: x\n", "no cells"),
        ("cell:\n  a: {}\n" + CELL, "unknown key 'cell'; did you mean 'cells'"),
        ("cells:\n  a: {modle: random}\n", "unknown key 'modle'; did you mean 'model'"),
        ("cells:\n  a: {model: fintuned}\n", "did you mean 'finetuned'"),
        ("cells:\n  a: {model: table1-pretraind}\n", "did you mean 'table1-pretrained'"),
        ("cells:\n  a: {model: nowhere/model}\n", "folder nowhere/model holds no weights"),
        ("cells:\n  a: {set: {losses.weights.colision: 1}}\n", "losses.weights.collision"),
        ("cells:\n  a: {set: {losses.weights.collision: lots}}\n", "losses.weights.collision"),
        (
            "base: {traning: {seed: 1}}\n" + CELL,
            "unknown setting 'traning'; did you mean 'training'",
        ),
        ("cells:\n  a: {paper: {valid: 0.5}}\n", "[value, standard error]"),
        ("cells:\n  a: {paper: {vaild: [1, 0]}}\n", "did you mean 'valid'"),
        ("cells:\n  a b: {}\n", "'a b' is no name"),
        ("seeds: [0, 0]\n" + CELL, "a seed is given twice"),
        ("seeds: zero\n" + CELL, "whole numbers"),
        ("cells:\n  planner: {model: random}\n", "must have model: planner"),
        ("table: {baseline: b}\n" + CELL, "unknown baseline 'b'"),
        ("table: {show: [vaild]}\n" + CELL, "did you mean 'valid'"),
        ("table: {rows: []}\n" + CELL, "unknown key 'rows'"),
        ("matrix: {axis: {}}\n" + CELL, "did you mean 'axes'"),
        ("matrix: {axes: {training.seed: [1]}}\ncells: [{name: a}]\n", "with a matrix"),
        ("matrix: {axes: {training.seed: [1]}}\ncells: {a: 3}\n", "cell 'a': wants 'key: value'"),
        ("matrix: {axes: {training.seed: [1]}, exclude: a}\n", "exclude wants a list"),
        ("matrix: {axes: {training.seed: [1]}, cells: [a]}\n", "matrix: cells: wants"),
        (f"matrix: {{axes: {{training.seed: {A_LOT}, x: {A_LOT}}}}}\n", "250,000 combinations"),
        (f"seeds: {list(range(3000))}\n" + CELL, "3,000 cells and seeds, more than 2,000"),
        (f"base: {list(range(60_000))}\n" + CELL, "more than 50,000 values"),
        ("cells: " + "[" * 5000 + "]" * 5000, "more than 20 levels of nesting"),
        ("cells: " + "{a: " * 900 + "1" + "}" * 900, "more than 20 levels of nesting"),
        ("base: &a [*a]\n" + CELL, "an alias is inside the value that it repeats"),
        (BOMB + CELL, "more than 50,000 values"),
        ("title: !!int abc\n" + CELL, "not valid YAML"),
        ("title: " + "9" * 5000 + "\n" + CELL, "not valid YAML"),
        ("title: [a]\n" + CELL, "title: wants one line"),
        ('title: "a\\nb"\n' + CELL, "title: wants one line"),
        ("name: " + "a" * 300 + "\n" + CELL, "up to 100 letters"),
        ("seeds: [true]\n" + CELL, "whole numbers"),
        ("seeds: [1000000000000]\n" + CELL, "whole numbers"),
        ("table: {show: [valid, valid]}\n" + CELL, "names a rate twice"),
        ("cells:\n  a: {paper: {valid: [nan, 0]}}\n", "between 0 and 1"),
        ("cells:\n  a: {paper: {valid: [7, 0]}}\n", "between 0 and 1"),
        ("presets: {mine: {training.batch_size: 0}}\n" + CELL, "presets.mine: training.batch_size"),
        ("cells:\n  a: {set: {execution.hold_time: -1}}\n", "cell 'a': execution.hold_time must"),
        ("presets: {paper: {}}\n" + CELL, "presets: preset 'paper' is now called 'full'"),
        ("[1, 2", "not valid YAML"),
        ("- a\n", "wants 'key: value' pairs"),
    ],
)
def test_what_is_wrong_is_said_on_one_line(tmp_path, text, part):
    assert part in error(tmp_path, text)


def test_a_sweep_that_is_not_there():
    with pytest.raises(DmfcError, match="did you mean 'table1'"):
        load_sweep("tabel1")
    with pytest.raises(DmfcError, match="does not exist"):
        load_sweep("nowhere/table1.yaml")
    assert load_sweep("sweeps/table1.yaml").cells == load_sweep("table1").cells


def test_planner_and_random_rows_are_always_there():
    for name in shipped_names("sweeps"):
        cells = {cell.name: cell.model for cell in load_sweep(name).cells}
        assert {"planner", "random"} <= set(cells.values())
        assert cells.get("random", "random") == "random"
        assert cells.get("planner", "planner") == "planner"


def test_table_one_is_the_papers():
    sweep = load_sweep("table1")
    cells = {cell.name: cell for cell in sweep.cells}
    assert list(cells) == [
        "pretrained", "collision", "guidance", "q1_upper", "all",
        "pretrained_checked", "all_checked", "planner", "random",
    ]  # fmt: skip
    assert cells["q1_upper"].paper == {
        "valid": (0.75, 0.02),
        "success": (0.73, 0.01),
        "overall": (0.55, 0.02),
    }
    for name in ("collision", "guidance", "q1_upper"):
        weights = cell_config(sweep, cells[name], 0, "full", []).losses.weights
        alone = {"chamfer": 0.0, "collision": 0.0, "guidance": 0.0, "q1_upper": 0.0, name: 1.0}
        assert {term: getattr(weights, term) for term in alone} == alone
    weights = cell_config(sweep, cells["all"], 0, "full", []).losses.weights
    assert min(getattr(weights, term) for term in alone) > 0


@pytest.mark.parametrize("name", ["table1", "table2"])
def test_a_checked_row_is_the_same_model_executed_with_the_cloud_check(name):
    sweep = load_sweep(name)
    cells = {cell.name: cell for cell in sweep.cells}
    for model in ("pretrained", "all"):
        plain, checked = (
            cell_config(sweep, cells[cell], 0, "full", []) for cell in (model, f"{model}_checked")
        )
        assert not plain.execution.cloud_check
        execution = dataclasses.replace(plain.execution, cloud_check=True)
        assert checked == dataclasses.replace(plain, execution=execution)
        assert cells[model].model == cells[f"{model}_checked"].model


def test_table_two_has_ten_thousand_scenes_of_several_objects():
    sweep = load_sweep("table2")
    config = cell_config(sweep, sweep.cells[0], 0, "full", [])
    assert config.scenes.train.count == 10_000
    assert (config.scenes.train.kind, config.scenes.test.kind) == ("multi", "multi")
    assert (config.scenes.train.min_objects, config.scenes.train.max_objects) == (3, 5)


def test_what_overrides_what(tmp_path):
    path = tmp_path / "my.yaml"
    path.write_text(
        "base: {training.batch_size: 7, scenes.test.count: 3}\n"
        "presets: {smoke: {scenes.test.count: 5}}\n"
        "cells:\n  a: {model: finetuned, set: {matching.mode: literal}}\n"
    )
    sweep = load_sweep(str(path))
    cell = sweep.cells[0]
    config = cell_config(sweep, cell, 9, "smoke", ["matching.mode=patch", "network.width=16"])
    assert config.training.batch_size == 7
    assert config.scenes.test.count == 5
    assert config.matching.mode == "literal"
    assert config.network.width == 16
    assert config.training.seed == config.execution.seed == 9
    assert cell_config(sweep, cell, 0, None, []).scenes.test.count == 3


def test_a_cell_may_execute_a_trained_model_as_it_is(tmp_path):
    from dmfc.prediction.models import model_folder

    shipped = model_folder("table1-pretrained")
    path = tmp_path / "my.yaml"
    path.write_text(f"cells:\n  a: {{model: table1-pretrained}}\n  b: {{model: {shipped}}}\n")
    a, b = load_sweep(str(path)).cells[:2]
    assert a.weights == b.weights == shipped
    plan = plan_sweep(load_sweep(str(path)), GraphBuilder(fake_refs), "smoke")
    one, two = plan.cells[:2]
    assert one.stages.model is None
    assert [s.key for s in one.stages.evaluations] == [s.key for s in two.stages.evaluations]
    assert "weights" in one.stages.evaluations[0].config


def test_seeds_may_be_by_preset(tmp_path):
    path = tmp_path / "s.yaml"
    path.write_text("seeds: {full: [0, 1, 2]}\n" + CELL)
    sweep = load_sweep(str(path))
    assert seeds_of(sweep, "full") == (0, 1, 2)
    assert seeds_of(sweep, ["full", "literal"]) == (0, 1, 2)
    assert seeds_of(sweep, "smoke") == seeds_of(sweep, None) == (0,)
    assert seeds_of(with_seeds(sweep, [3, 4]), "full") == (3, 4)
    with pytest.raises(DmfcError, match="a seed is given twice"):
        with_seeds(sweep, [1, 1])
    path.write_text("seeds: {full: [0, 0]}\n" + CELL)
    with pytest.raises(DmfcError, match=r"seeds\.full: a seed is given twice"):
        load_sweep(str(path))


@pytest.mark.parametrize("name", ["table1", "table2", "loss_combinations", "outcome"])
def test_tables_of_full_size_have_three_seeds_and_seed_0_is_what_it_was(name):
    sweep = load_sweep(name)
    assert seeds_of(sweep, "full") == (0, 1, 2)
    assert seeds_of(sweep, "quick") == (0,)
    builder = GraphBuilder(fake_refs, FAKES)
    three = plan_sweep(sweep, builder, "full")
    alone = plan_sweep(with_seeds(sweep, [0]), builder, "full")
    keys = {(plan.cell.name, plan.seed): plan.identity for plan in three.cells}
    assert len(keys) == 3 * len(alone.cells)
    assert all(keys[plan.cell.name, 0] == plan.identity for plan in alone.cells)
