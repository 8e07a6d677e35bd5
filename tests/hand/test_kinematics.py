"""Forward kinematics against MuJoCo, and its gradient."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
import torch

from dmfc.geometry.rotations import geodesic_angle
from dmfc.geometry.transforms import apply, rotate, transform
from dmfc.hand.kinematics import HandKinematics
from dmfc.hand.mjcf import PREFIX
from dmfc.hand.model import HandModel
from tests.support.rotations import random_rotations

COUPLED = {f"rh_{finger}J1": f"rh_{finger}J2" for finger in ("FF", "MF", "RF", "LF")}


def random_joints(hand: HandModel, count: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).uniform(hand.lower, hand.upper, (count, hand.dofs))


def mujoco_poses(hand: HandModel, model: mujoco.MjModel, joints: np.ndarray) -> np.ndarray:
    data, poses = mujoco.MjData(model), []
    for row in joints:
        angles = dict(zip(hand.dof_names, row, strict=True))
        angles |= {joint: angles[driver] for joint, driver in COUPLED.items()}
        for name, angle in angles.items():
            data.joint(PREFIX + name).qpos = angle
        mujoco.mj_kinematics(model, data)
        poses.append(transform(data.xmat[1:].reshape(-1, 3, 3), data.xpos[1:]))
    return np.array(poses)


@pytest.mark.parametrize(("dtype", "tolerance"), [(torch.float64, 1e-12), (torch.float32, 5e-6)])
def test_links_are_where_mujoco_puts_them(
    hand: HandModel, mujoco_model: mujoco.MjModel, dtype: torch.dtype, tolerance: float
) -> None:
    joints = random_joints(hand, 1000)
    ours = HandKinematics(hand).forward(torch.tensor(joints, dtype=dtype)).double()
    theirs = torch.tensor(mujoco_poses(hand, mujoco_model, joints))
    assert ours.shape == (1000, hand.links, 4, 4)
    assert (ours - theirs)[..., :3, 3].norm(dim=-1).max() < tolerance
    assert geodesic_angle(ours[..., :3, :3], theirs[..., :3, :3]).max() < tolerance


def test_points_move_with_palm_and_links(hand: HandModel) -> None:
    kinematics = HandKinematics(hand)
    joints = torch.tensor(random_joints(hand, 3))
    generator = torch.Generator().manual_seed(0)
    rotation = random_rotations(3, generator, torch.float64)
    T_x_palm = transform(rotation, torch.randn(3, 3, generator=generator, dtype=torch.float64))
    T_palm_link = kinematics.forward(joints)
    points = kinematics.collision_points(T_x_palm, joints)
    inner, normals = kinematics.inner_points(T_x_palm, joints)
    for grasp in range(3):
        for i in range(0, len(hand.collision_link), 97):
            T = T_x_palm[grasp] @ T_palm_link[grasp, hand.collision_link[i]]
            expected = apply(T, torch.tensor(hand.collision_points[i : i + 1]))
            assert torch.allclose(points[grasp, i], expected[0], atol=1e-12)
        for i, link in enumerate(hand.inner_link):
            T = T_x_palm[grasp] @ T_palm_link[grasp, link]
            expected = apply(T, torch.tensor(hand.inner_points[i : i + 1]))
            assert torch.allclose(inner[grasp, i], expected[0], atol=1e-12)
            expected = rotate(T, torch.tensor(hand.inner_normals[i : i + 1]))
            assert torch.allclose(normals[grasp, i], expected[0], atol=1e-12)


def test_gradient_reaches_joints_and_palm(hand: HandModel) -> None:
    kinematics = HandKinematics(hand)
    joints = torch.tensor(random_joints(hand, 1, seed=1), requires_grad=True)
    rotation = random_rotations(1, torch.Generator().manual_seed(1), torch.float64)
    T_x_palm = transform(rotation, torch.zeros(1, 3, dtype=torch.float64)).requires_grad_()

    def some(T: torch.Tensor, q: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        points, normals = kinematics.inner_points(T, q)
        return points[:, ::4], normals[:, ::4]

    assert torch.autograd.gradcheck(some, (T_x_palm, joints), atol=1e-6)


def test_clamp(hand: HandModel) -> None:
    kinematics = HandKinematics(hand)
    wide = torch.full((2, hand.dofs), 9.0, dtype=torch.float64)
    assert np.array_equal(kinematics.clamp(wide)[0], hand.upper)
    assert np.array_equal(kinematics.clamp(-wide)[1], hand.lower)
