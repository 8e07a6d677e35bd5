"""A second hand from its MJCF, by its description alone."""

from __future__ import annotations

from functools import cache

import mujoco
import numpy as np
import pytest
import torch

from dmfc.config.grasps import GraspsConfig
from dmfc.config.hand import HandConfig
from dmfc.config.losses import Q1Config
from dmfc.config.physics import PhysicsConfig
from dmfc.grasps.planner import plan
from dmfc.hand.build import build_hand
from dmfc.hand.description import load_description
from dmfc.hand.kinematics import HandKinematics
from dmfc.hand.mjcf import PREFIX, hand_model
from dmfc.hand.model import HandModel
from tests.support.physics_shapes import block

pytestmark = pytest.mark.full  # pulls a pack of 89 MB


@cache
def leap() -> HandModel:
    return build_hand(HandConfig(name="leap", link_sdf_spacing=0.004))


def test_links_are_where_mujoco_has_them():
    hand, description = leap(), load_description("leap")
    assert hand.dofs == 16
    model = hand_model(description)
    assert (model.actuator_forcerange[:, 1] == description.max_torque).all()
    data = mujoco.MjData(model)
    joints = np.random.default_rng(0).uniform(hand.lower, hand.upper)
    for name, value in zip(hand.dof_names, joints, strict=True):
        data.qpos[model.joint(PREFIX + name).qposadr] = value
    mujoco.mj_kinematics(model, data)
    links = HandKinematics(hand).forward(torch.as_tensor(joints)[None])[0].numpy()
    for name, T in zip(hand.link_names, links, strict=True):
        assert np.allclose(T[:3, 3], data.body(PREFIX + name).xpos, atol=1e-6), name


def test_inner_points_face_what_is_held():
    """Those of the straight fingers and of the palm look out of the palm, the thumb's, turned to
    face the fingers, along them."""
    hand = leap()
    links = HandKinematics(hand).forward(torch.as_tensor(hand.open_joints)[None])[0].numpy()
    normals = np.einsum("nij,nj->ni", links[hand.inner_link, :3, :3], hand.inner_normals)
    thumb = np.array([hand.link_names[i].startswith("th") for i in hand.inner_link])
    assert (normals[~thumb] @ hand.palm_normal > 0.7).all()
    assert (normals[thumb] @ [1, 0, 0] > 0.7).all()


def test_the_planner_finds_grasps_that_hold():
    config = GraspsConfig(per_object=2, max_checks=20)
    physics = PhysicsConfig(gain_scale=1.0)
    model = block(size=(0.05, 0.06, 0.12))
    found = plan(model, leap(), load_description("leap"), config, physics, Q1Config())
    assert len(found) >= 1
    assert found.hand == "leap"
    assert found.penetration.max() < config.max_penetration
