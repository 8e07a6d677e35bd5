"""The golden run: twenty steps of each stage, as they were when the numbers were stored."""

from __future__ import annotations

import json

import numpy as np

from tests.training.golden_run import (
    FILE,
    PROJECTED,
    STEPS,
    SWEPT,
    TRAINING,
    golden_run,
    with_weight,
)

TOLERANCE = 1e-3
"""Relative; float32 sums differ between processors (vector width), and twenty steps carry that."""


GUIDED = with_weight("guidance", 1.02)


def worst(measured: list[dict[str, float]], stored: list[dict[str, float]]) -> float:
    """Largest relative difference of any term of any step."""
    assert [set(row) for row in measured] == [set(row) for row in stored]
    pairs = [(new[k], old[k]) for new, old in zip(measured, stored, strict=True) for k in old]
    values = np.array(pairs)
    return float((np.abs(values[:, 0] - values[:, 1]) / np.abs(values[:, 1]).clip(1e-3)).max())


def test_golden_run(tmp_path):
    stored = json.loads(FILE.read_text())
    first = golden_run("pretrain", tmp_path / "first", None)
    assert len(first) == STEPS
    assert worst(first, stored["pretrain"]) < TOLERANCE
    second = golden_run("finetune", tmp_path / "second", tmp_path / "first")
    assert worst(second, stored["finetune"]) < TOLERANCE
    for name, training in (("swept", TRAINING), ("projected", PROJECTED)):
        third = golden_run("finetune", tmp_path / name, tmp_path / "first", SWEPT, training)
        assert worst(third, stored[name]) < TOLERANCE
    # It would notice a weight that is 2 % off.
    other = golden_run("finetune", tmp_path / "other", tmp_path / "first", GUIDED)
    assert worst(other, stored["finetune"]) > 2 * TOLERANCE
