"""The hardest predictions against brute force."""

from __future__ import annotations

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from dmfc.training.means import Means
from dmfc.training.selection import hardest


def brute_force(error: list[float], scene: list[int], count: int, scope: str) -> set[int]:
    rows = sorted(range(len(error)), key=lambda i: (-error[i], i))
    if scope == "batch":
        return set(rows[:count])
    return {i for s in set(scene) for i in [r for r in rows if scene[r] == s][:count]}


@given(
    rows=st.lists(st.tuples(st.integers(0, 9), st.integers(0, 3)), min_size=1, max_size=60),
    count=st.integers(1, 20),
    scope=st.sampled_from(["batch", "scene"]),
)
@settings(max_examples=150, deadline=None)
def test_hardest_equals_brute_force(rows, count, scope):
    error, scene = [float(e) for e, _ in rows], [s for _, s in rows]
    chosen = hardest(torch.tensor(error), torch.tensor(scene), count, scope).tolist()
    assert len(chosen) == len(set(chosen))
    assert set(chosen) == brute_force(error, scene, count, scope)


def test_zero_takes_all_and_the_highest_come_first():
    error = torch.tensor([1.0, 3.0, 2.0, 3.0])
    assert hardest(error, torch.zeros(4, dtype=torch.int64), 0).tolist() == [1, 3, 2, 0]


def test_an_error_that_is_not_finite_is_chosen_first():
    error = torch.tensor([1.0, torch.nan, 2.0])
    assert hardest(error, torch.zeros(3, dtype=torch.int64), 1).tolist() == [1]


def test_selection_carries_no_gradient():
    error = torch.tensor([1.0, 2.0], requires_grad=True)
    assert not hardest(error, torch.zeros(2, dtype=torch.int64), 1).requires_grad


def test_means_are_of_values_not_of_batches():
    means = Means()
    means.add("a", torch.tensor([1.0, 2.0, 3.0]))
    means.add("a", torch.tensor([10.0]))
    means.add("b", torch.zeros(0))
    assert means.result(lambda t: t) == {"a": pytest.approx(4.0)}
    assert means.count("a") == 4
    assert Means().result(lambda t: t) == {}
