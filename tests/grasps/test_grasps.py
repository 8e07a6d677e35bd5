"""The one record of grasps: length, rows, poses, and another frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from dmfc.grasps.grasps import Grasps


@dataclass(frozen=True)
class Named(Grasps):
    """With a column, and with something that is none."""

    score: np.ndarray
    hand: str


@pytest.fixture
def some() -> Named:
    generator = np.random.default_rng(0)
    return Named(
        position=generator.uniform(-1, 1, (5, 3)),
        rotation=Rotation.random(5, rng=generator).as_matrix(),
        joints=generator.uniform(-1, 1, (5, 2)),
        score=np.arange(5.0),
        hand="claw",
    )


@pytest.mark.parametrize(
    ("rows", "expected"),
    [
        (slice(1, 3), [1, 2]),
        (np.array([4, 0]), [4, 0]),
        (np.array([True, False, False, True, False]), [0, 3]),
        (np.zeros(0, dtype=int), []),
    ],
)
def test_rows_are_taken_of_every_column(some, rows, expected):
    taken = some[rows]
    assert isinstance(taken, Named)
    assert len(taken) == len(expected)
    assert taken.score.tolist() == expected
    assert np.array_equal(taken.position, some.position[expected])
    assert np.array_equal(taken.rotation, some.rotation[expected])
    assert np.array_equal(taken.joints, some.joints[expected])
    assert taken.hand == "claw"


def test_poses_and_another_frame_are_those_of_scipy(some):
    poses = RigidTransform.from_components(some.position, Rotation.from_matrix(some.rotation))
    assert np.allclose(some.T, poses.as_matrix(), atol=1e-12)
    turn = RigidTransform.from_components([0.3, -0.2, 1.0], Rotation.from_rotvec([0.4, 1.0, -2.0]))
    moved = some.in_frame(turn.as_matrix())
    assert np.allclose(moved.T, (turn * poses).as_matrix(), atol=1e-12)
    assert np.array_equal(moved.joints, some.joints)
    back = moved.in_frame(turn.inv().as_matrix())
    assert np.allclose(back.T, some.T, atol=1e-12)
