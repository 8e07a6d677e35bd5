"""The view of a small cloud of a box with three grasps."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dmfc.hand.model import HandModel
from dmfc.prediction.ranked import RankedGrasps
from dmfc.view.data import View, cloud_view

HOSTILE = "</script><script>alert(1)</script>&<!--"


@pytest.fixture(scope="session")
def grasps(hand: HandModel) -> RankedGrasps:
    """Forty with confidences from 0.9 down to 0.1, around the box."""
    generator = np.random.default_rng(0)
    count = 40
    rotation = Rotation.random(count, rng=generator).as_matrix()
    position = generator.uniform(-0.1, 0.1, (count, 3)) + np.array([0, 0, 0.1])
    share = generator.uniform(0.1, 0.9, (count, hand.dofs))
    return RankedGrasps(
        position=position,
        rotation=rotation,
        joints=hand.lower + share * (hand.upper - hand.lower),
        confidence=np.linspace(0.9, 0.1, count),
        point=np.arange(count),
        dof_names=hand.dof_names,
        hand="shadow",
        model="by chance",
    )


@pytest.fixture(scope="session")
def view(hand: HandModel, grasps: RankedGrasps) -> View:
    points = np.random.default_rng(1).uniform(-0.04, 0.04, (900, 3)) + np.array([0, 0, 0.07])
    return cloud_view(points, grasps, hand, HOSTILE)
