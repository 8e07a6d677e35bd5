"""The baselines grasp a block that stands on the table; retrieval finds the very object again."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from dmfc.execution.candidates import from_answer
from dmfc.execution.selection import select
from dmfc.methods.answer import checked
from dmfc.methods.baselines import nearest_label, top_down
from dmfc.methods.observation import observe
from dmfc.sweep.models import method_text, shipped_methods, source_of
from tests.support.execution_shapes import runner, scene_of, standing
from tests.support.grasp_shapes import shape


@pytest.fixture(scope="module")
def block(hand):
    scene = scene_of(0, ["block"], [standing("block", 0.02, -0.03, 0.4)], [], points=800)
    return scene, observe(scene, hand, {})


@pytest.mark.parametrize("method", [top_down, nearest_label])
def test_a_baseline_grasps_a_block(block, method):
    scene, seen = block
    answer = checked(method.predict(seen), seen)
    assert len(answer) > 0
    trials = runner([shape("block")], list(scene.T_world_object))
    config = dataclasses.replace(trials.config, min_confidence=-np.inf)  # as for any method
    chosen = select(from_answer(scene, answer), config).chosen
    assert any(trials.run(chosen.T[k], chosen.joints[k], 0).held for k in range(len(chosen)))


def test_the_hand_closes_across_the_narrow_side(block):
    scene, seen = block
    hand = seen.hand
    _, across = top_down.grip(
        hand, np.clip(hand.open_joints + 0.6 * hand.flexion, hand.lower, hand.upper)
    )
    assert across @ hand.palm_normal == pytest.approx(0, abs=1e-9)
    answer = checked(top_down.predict(seen), seen)
    best = int(answer.score.argmax())
    # The block is 5 cm wide along its own x axis, 6 cm along y.
    narrow = scene.T_world_object[0][:3, 0]
    assert abs((answer.rotation[best] @ across) @ narrow) > 0.99
    assert (answer.rotation[best] @ hand.palm_normal)[2] == pytest.approx(-1)
    assert seen.used == set()


def test_clusters_are_parted_by_gaps():
    line = np.c_[np.arange(0, 0.3, 0.005), np.zeros((60, 2))]
    parted = np.concatenate([line, line + np.array([0, 0.05, 0]), np.ones((1, 3))])
    assert sorted(map(len, top_down.clusters(parted))) == [60, 60]


def test_an_object_of_the_library_is_aligned_with_itself():
    """Its own points, turned and moved, lie on it again."""
    from scipy.spatial import cKDTree
    from scipy.spatial.transform import Rotation

    known = nearest_label.labelled("shadow")
    assert len(known) == 24
    box = known[0]
    R = Rotation.random(rng=3).as_matrix()
    moved = box.surface[::2] @ R.T + [0.1, 0.2, 0.3]
    axes, centre, extents = nearest_label.box_of(moved)
    assert np.linalg.det(axes) == pytest.approx(1)
    np.testing.assert_allclose(extents, box.extents, atol=0.002)
    turn, error = nearest_label._aligned((moved - centre) @ axes, box.surface)
    assert error < 0.003
    back = box.surface @ (axes @ turn).T + centre
    assert cKDTree(moved).query(back)[0].mean() < 0.006


def test_shipped_methods_have_names():
    assert set(shipped_methods()) == {"nearest_label", "top_down"}
    found = source_of("top_down", "cell")
    assert found.method == method_text("top_down")
    assert found.method.endswith("top_down.py:predict")
