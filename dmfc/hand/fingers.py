"""The fingers of a hand, the subtrees that hang on the palm, and the direction of their tips."""

from __future__ import annotations

import numpy as np
import torch

from dmfc.hand.kinematics import HandKinematics
from dmfc.hand.model import HandModel


def finger_axis(hand: HandModel) -> np.ndarray:
    """[3] the direction from the palm's centre to the finger tips of the straight hand."""
    T = HandKinematics(hand).forward(torch.zeros(1, hand.dofs))[0].numpy()
    tips = T[:, :3, 3] - hand.palm_reference
    axis = tips[np.argmax(np.linalg.norm(tips, axis=1))]
    axis = axis - (axis @ hand.palm_normal) * hand.palm_normal
    return axis / np.linalg.norm(axis)


def fingers(hand: HandModel) -> tuple[np.ndarray, np.ndarray]:
    """Finger of each degree of freedom [D] and of each link [L]; -1 for the palm.

    A finger is a subtree that hangs on the palm.
    """
    finger_of_link = np.full(hand.links, -1)
    count = 0
    for link in range(1, hand.links):
        parent = hand.parents[link]
        if parent == 0:
            finger_of_link[link], count = count, count + 1
        else:
            finger_of_link[link] = finger_of_link[parent]
    finger_of_dof = np.full(hand.dofs, -1)
    moved = hand.joint_dof >= 0
    finger_of_dof[hand.joint_dof[moved]] = finger_of_link[moved]
    return finger_of_dof, finger_of_link
