"""How far apart grasps are, against pairs counted one by one."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dmfc.execution.diversity import diversity
from tests.execution.test_candidates import some


def test_against_every_pair() -> None:
    grasps = some(12)
    pairs = list(combinations(range(12), 2))
    turn = Rotation.from_matrix(grasps.rotation)
    found = diversity(grasps)
    expected = {
        "position": [np.linalg.norm(grasps.position[i] - grasps.position[j]) for i, j in pairs],
        "rotation": [(turn[i].inv() * turn[j]).magnitude() for i, j in pairs],
        "joints": [np.linalg.norm(grasps.joints[i] - grasps.joints[j]) for i, j in pairs],
    }
    for name, values in expected.items():
        assert found[name] == pytest.approx(np.mean(values), rel=1e-6)


def test_one_grasp_is_not_different_and_equal_ones_are_not_either() -> None:
    assert np.isnan(list(diversity(some(1)).values())).all()
    same = diversity(some(5)[np.zeros(4, dtype=int)])
    assert list(same.values()) == pytest.approx([0, 0, 0], abs=1e-6)
