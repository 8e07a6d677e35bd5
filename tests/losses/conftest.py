"""Closed-form objects on grids, and scenes of them."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from dmfc.geometry.grid import Grid
from dmfc.geometry.transforms import transform
from dmfc.objects.atlas import ObjectAtlas, SceneObjects
from tests.support.loss_shapes import BOX, ball_distance, box_distance
from tests.support.rotations import random_rotations


@pytest.fixture(scope="session")
def atlas() -> ObjectAtlas:
    """Row 0: a ball of radius 4 cm; row 1: a box of 6 x 10 x 4 cm; both on 1 mm grids."""
    grids = [
        Grid.sample(distance, -reach, reach, 0.001)
        for distance, reach in [(ball_distance, np.full(3, 0.06)), (box_distance, BOX + 0.02)]
    ]
    return ObjectAtlas(["ball", "box"], grids, np.array([[0, 0, 0], [0, 0, 0.01]]))


@pytest.fixture
def scene(atlas: ObjectAtlas) -> SceneObjects:
    """Two grasps: one beside a ball and a box, one beside a ball alone."""
    generator = torch.Generator().manual_seed(0)
    rotation = random_rotations(4, generator, torch.float64)
    position = torch.tensor([[0, 0, 0.1], [0.12, 0, 0.1], [0.02, 0.01, 0.1], [0, 0, 0]])
    T = transform(rotation, position.double()).reshape(2, 2, 4, 4)
    return SceneObjects(atlas, torch.tensor([[0, 1], [0, -1]]), T)
