"""Answers that are refused, each by one line that names what is wrong; and those that are not."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dmfc.errors import DmfcError
from dmfc.methods.answer import checked
from dmfc.methods.observation import Observation


@pytest.fixture
def seen(hand):
    points = np.random.default_rng(0).uniform(-0.05, 0.05, (200, 3)).astype(np.float32)
    numbers = np.zeros(200, dtype=np.int64)
    return Observation("0000-0", points, numbers, np.zeros((4, 3)), hand, points, numbers)


@pytest.fixture
def good(hand):
    return {
        "position": np.zeros((3, 3)),
        "rotation": Rotation.random(3, rng=0).as_matrix(),
        "joints": np.tile(hand.open_joints, (3, 1)),
        "joint_names": hand.dof_names,
        "score": np.arange(3),
    }


def test_joints_are_matched_by_their_names(seen, good, hand):
    order = np.random.default_rng(1).permutation(len(hand.dof_names))
    angles = np.random.default_rng(2).uniform(hand.lower, hand.upper, (3, len(order)))
    names = [hand.dof_names[k] for k in order]
    found = checked({**good, "joints": angles[:, order], "joint_names": names}, seen)
    np.testing.assert_array_equal(found.joints, angles)


def test_a_quaternion_is_as_good_as_a_matrix(seen, good):
    turns = Rotation.random(3, rng=0).as_quat(scalar_first=True)
    rest = {key: value for key, value in good.items() if key != "rotation"}
    found = checked({**rest, "quaternion": turns}, seen)
    np.testing.assert_allclose(found.rotation, good["rotation"], atol=1e-12)


def test_a_joint_a_little_beyond_its_limit_is_clamped(seen, good, hand):
    over = {**good, "joints": np.tile(hand.upper + 0.04, (3, 1))}
    np.testing.assert_array_equal(checked(over, seen).joints, np.tile(hand.upper, (3, 1)))


def test_no_grasp_is_an_answer(seen, good):
    empty = {"position": [], "quaternion": [], "joints": [], "score": []}
    found = checked({**empty, "joint_names": good["joint_names"]}, seen)
    assert len(found) == 0
    assert found.rotation.shape == (0, 3, 3)


def nan(array):
    array = np.array(array, dtype=float)
    array.flat[-1] = np.nan
    return array


@pytest.mark.parametrize(
    ("change", "line"),
    [
        (lambda g: {"position": np.zeros((3, 4))}, r"position is \[3, 4\], not \[n, 3\]"),
        (lambda g: {"position": nan(g["position"])}, "position of grasp 2 is not finite"),
        (lambda g: {"position": "here"}, "position holds no numbers"),
        (lambda g: {"position": 1000 * np.ones((3, 3))}, "palm of grasp .* m from the cloud"),
        (lambda g: {"score": np.zeros(2)}, r"score is \[2\], not \[3\]"),
        (lambda g: {"score": 1.0}, r"score is \[\], not \[3\]"),
        (lambda g: {"joints": nan(g["joints"])}, "joints of grasp 2 is not finite"),
        (lambda g: {"joints": g["joints"][:, 1:]}, r"joints is \[3, \d+\], not \[3, \d+\]"),
        (lambda g: {"joints": np.rad2deg(g["joints"] + 0.5)}, "its limits are"),
        (lambda g: {"joint_names": [*g["joint_names"][:-1], "thumb"]}, "unknown joint .*'thumb'"),
        (lambda g: {"joint_names": [*g["joint_names"][:-1], g["joint_names"][0]]}, "twice"),
        (lambda g: {"joint_names": None}, "the answer has no joint_names"),
        (
            lambda g: {"joints": g["joints"][:, :-1], "joint_names": g["joint_names"][:-1]},
            "joint_names lacks",
        ),
        (lambda g: {"rotation": -g["rotation"]}, "no rotation"),
        (lambda g: {"rotation": 2 * g["rotation"]}, "no rotation"),
        (lambda g: {"rotation": None}, "either rotation"),
        (lambda g: {"rotation": None, "quaternion": np.ones((3, 4))}, "length 1"),
        (lambda g: {"frame": "camera"}, "in the frame 'camera'"),
        (lambda g: {"point": [0, 1, 200]}, "point of grasp 2 is 200"),
        (lambda g: {"point": [0, 0.5, 1]}, "point of grasp 1 is 0.5"),
        (lambda g: {"postion": 1}, "did you mean 'position'"),
    ],
)
def test_what_is_wrong_is_one_line(seen, good, change, line):
    with pytest.raises(DmfcError, match=line) as raised:
        checked({**good, **change(good)}, seen)
    assert "\n" not in str(raised.value)
