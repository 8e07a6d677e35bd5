"""The compiled loops of the proposals against kinematics and grid, point by point."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from dmfc.grasps import hand_kernel
from dmfc.grasps.hand_arrays import grid_arrays, hand_arrays
from dmfc.hand.fingers import fingers
from dmfc.hand.kinematics import HandKinematics
from dmfc.hand.model import HandModel
from tests.support.grasp_shapes import BLOCK_SIZE, shape

POSES = 60
STILL = np.zeros(3)


@pytest.fixture(scope="module")
def poses(hand: HandModel) -> tuple[np.ndarray, np.ndarray]:
    """T_object_palm [POSES, 4, 4] around the block, some inside it, and joints [POSES, D]."""
    generator = np.random.default_rng(3)
    T = np.tile(np.eye(4), (POSES, 1, 1))
    T[:, :3, :3] = Rotation.random(POSES, random_state=generator).as_matrix()
    T[:, :3, 3] = generator.uniform(-0.1, 0.1, (POSES, 3))
    return T, generator.uniform(hand.lower, hand.upper, (POSES, hand.dofs))


@pytest.fixture(scope="module")
def placed(
    hand: HandModel, poses: tuple[np.ndarray, np.ndarray]
) -> list[tuple[np.ndarray, np.ndarray]]:
    """The kernel's link poses of each hand."""
    arrays = hand_arrays(hand, fingers(hand)[1])
    found = []
    for T, joints in zip(*poses, strict=True):
        R, t = np.empty((hand.links, 3, 3)), np.empty((hand.links, 3))
        hand_kernel.place(arrays, T[:3, :3].copy(), T[:3, 3].copy(), joints, R, t)
        found.append((R, t))
    return found


@pytest.fixture(scope="module")
def points(hand: HandModel, poses: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
    """[POSES, P, 3] by the hand's kinematics."""
    T, joints = (torch.as_tensor(array) for array in poses)
    return HandKinematics(hand).collision_points(T, joints).numpy()


def test_links_are_where_the_kinematics_put_them(
    hand: HandModel,
    poses: tuple[np.ndarray, np.ndarray],
    placed: list[tuple[np.ndarray, np.ndarray]],
) -> None:
    T, joints = (torch.as_tensor(array) for array in poses)
    expected = HandKinematics(hand).links(T, joints).numpy()
    for (R, t), links in zip(placed, expected, strict=True):
        assert pytest.approx(links[:, :3, :3], abs=1e-9) == R
        assert pytest.approx(links[:, :3, 3], abs=1e-9) == t


def test_a_lookup_is_that_of_the_grid() -> None:
    grid = shape("block").sdf
    where = np.random.default_rng(0).uniform(-1.5, 1.5, (500, 3)) * BLOCK_SIZE
    arrays = grid_arrays(grid)
    found = [hand_kernel.lookup(arrays, *point) for point in where]
    assert np.array(found) == pytest.approx(grid.distance(where), abs=1e-7)


def test_deepest_is_the_largest_distance_of_all_points(
    hand: HandModel, placed: list[tuple[np.ndarray, np.ndarray]], points: np.ndarray
) -> None:
    finger = fingers(hand)[1]
    arrays, sdf = hand_arrays(hand, finger), shape("block").sdf
    grid, shift = grid_arrays(sdf), np.array([0.0, 0.01, -0.02])
    depth = sdf.distance(points + shift)
    for (R, t), own in zip(placed, depth, strict=True):
        for which in (hand_kernel.ALL, -1, 0, 4):
            among = finger[hand.collision_link] == which
            expected = own.max() if which == hand_kernel.ALL else own[among].max()
            found = hand_kernel.deepest(arrays, R, t, which, shift, grid, -np.inf, np.inf)
            assert found == pytest.approx(expected, abs=1e-7)
        floored = hand_kernel.deepest(arrays, R, t, hand_kernel.ALL, shift, grid, -0.01, 0.0)
        assert (floored > 0.0) == (own.max() > 0.0)
        assert own.max() > 0.0 or floored == pytest.approx(max(own.max(), -0.01), abs=1e-7)
    assert 0.2 < (depth.max(axis=1) > 0).mean() < 0.8


def test_above_looks_at_every_point(
    hand: HandModel, placed: list[tuple[np.ndarray, np.ndarray]], points: np.ndarray
) -> None:
    arrays = hand_arrays(hand, fingers(hand)[1])
    plane = np.array([0.48, 0.6, 0.64, 0.15])
    lowest = (points @ plane[:3] + plane[3]).min(axis=1)
    found = [hand_kernel.above(arrays, R, t, STILL, plane) for R, t in placed]
    assert found == (lowest > 0.0).tolist()
    assert any(found)
    assert not all(found)
