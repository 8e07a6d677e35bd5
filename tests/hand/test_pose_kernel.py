"""The compiled forward kinematics against pytorch-kinematics."""

from __future__ import annotations

import numpy as np
import torch

from dmfc.hand.kinematics import HandKinematics
from dmfc.hand.model import HandModel
from dmfc.hand.pose_kernel import link_poses


def test_links_are_where_pytorch_kinematics_has_them(hand: HandModel) -> None:
    joints = np.random.default_rng(0).uniform(hand.lower, hand.upper, (7, hand.dofs))
    expected = HandKinematics(hand).forward(torch.as_tensor(joints)).numpy()
    np.testing.assert_allclose(link_poses(hand, joints), expected, atol=1e-12)
    assert link_poses(hand, joints[:0]).shape == (0, hand.links, 4, 4)
