"""Cells as combinations: all of them, less what is excluded."""

import itertools

import pytest

from dmfc.errors import DmfcError
from dmfc.sweep.matrix import expand
from dmfc.sweep.sweep_file import cell_config, load_sweep

TWO = {
    "a": {"-": {"training.seed": 1}, "big": {"training.seed": 2}},
    "training.batch_size": [2, 4],
}


def test_all_combinations_less_the_excluded():
    cells = expand({"axes": TWO}, "here")
    assert list(cells) == ["batch_size-2", "batch_size-4", "big+batch_size-2", "big+batch_size-4"]
    assert cells["big+batch_size-4"]["set"] == {"training.seed": 2, "training.batch_size": 4}
    left = expand({"axes": TWO, "exclude": [{"a": "big", "training.batch_size": 4}]}, "here")
    assert set(cells) - set(left) == {"big+batch_size-4"}
    left = expand({"axes": TWO, "exclude": [{"a": "-"}]}, "here")
    assert list(left) == ["big+batch_size-2", "big+batch_size-4"]


@pytest.mark.parametrize(
    ("matrix", "part"),
    [
        ({}, "wants 'axes'"),
        ({"axes": {"a": 3}}, "a list of values"),
        ({"axes": {"a": {"x": 3}}}, "x wants settings"),
        ({"axes": TWO, "exclude": [{"b": 1}]}, "unknown axis 'b'"),
        ({"axes": TWO, "exclude": [{"a": "bgi"}]}, "did you mean 'big'"),
        ({"axes": TWO, "exclude": [{"a": "big"}, {"a": "-"}]}, "every combination"),
        ({"axes": TWO, "cells": {"bgi": {}}}, "unknown cell 'bgi'"),
        ({"axes": {"a": {"x": {"s": 1}}, "s": [1]}}, "two axes set 's'"),
        ({"axes": {"a": {"x": None, "-": None}, "b": {"x": None, "-": None}}}, "named 'x'"),
    ],
)
def test_what_is_wrong_is_said_on_one_line(matrix, part):
    with pytest.raises(DmfcError, match=part) as caught:
        expand(matrix, "here")
    assert "\n" not in str(caught.value)


def test_loss_combinations_are_the_fifteen_and_both_readings():
    sweep = load_sweep("loss_combinations")
    terms = ("chamfer", "collision", "guidance", "q1_upper")
    found = {}
    for cell in sweep.cells:
        if cell.model == "finetuned":
            weights = cell_config(sweep, cell, 0, "smoke", []).losses.weights
            found[tuple(getattr(weights, term) for term in terms)] = cell
    assert set(found) == set(itertools.product((0.0, 1.0), repeat=4)) - {(0.0,) * 4}
    assert sum(cell.model == "pretrained" for cell in sweep.cells) == 1
    table1 = {cell.name: cell.paper for cell in load_sweep("table1").cells}
    for place, term in enumerate(terms[1:], start=1):
        alone = tuple(float(i == place) for i in range(4))
        assert found[alone].paper == found[(1.0, *alone[1:])].paper == table1[term]
    assert found[(1.0,) * 4].paper == table1["all"]
