"""Training as the benchmarks run it: scenes of four boxes with random labels, all terms on.

A network fresh from its start has hands that collide, so that every term has work to do.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import torch

from dmfc.config.losses import LossConfig, LossWeights, Q1Config
from dmfc.config.network import NetworkConfig
from dmfc.config.training import TrainingConfig
from dmfc.geometry.points import farthest_points
from dmfc.hand.model import HandModel
from dmfc.network.checkpoint import new_network
from dmfc.objects.atlas import ObjectAtlas
from dmfc.training.batch import Batch
from dmfc.training.module import GraspTraining
from dmfc.training.task import Stage, Task
from tests.support.rotations import random_rotations
from tests.support.toy import Box, box_grid, box_points

OBJECTS = 4
LOSSES = LossConfig(weights=LossWeights(1.0, 1.0, 1.0, 1.0, 1.0), q1=Q1Config(directions=728))
HALF = np.array([0.04, 0.03, 0.06])


def surface_cloud(batch: int, points: int = 2048) -> torch.Tensor:
    """Points on the surface of a 15 x 10 x 12 cm box, per cloud."""
    generator = torch.Generator().manual_seed(0)
    inside = torch.rand(batch, points, 3, generator=generator)
    axis = torch.randint(0, 3, (batch, points, 1), generator=generator)
    side = torch.randint(0, 2, (batch, points, 1), generator=generator).float()
    return inside.scatter(2, axis, side) * torch.tensor([0.15, 0.10, 0.12])


def batch_of(
    size: int, dofs: int, points: int = 2048, seeds: int = 512, labels: int = 256
) -> Batch:
    """A batch of `size` scenes as the loader makes it; each of `labels` seeds has one label."""
    generator = np.random.default_rng(0)
    torch.manual_seed(0)
    place = np.array([[-0.1, -0.1], [0.1, -0.1], [-0.1, 0.1], [0.1, 0.1]])
    T = torch.eye(4).repeat(size, OBJECTS, 1, 1)
    T[..., :2, 3] = torch.from_numpy(place).float()
    T[..., 2, 3] = HALF[2]
    clouds = [box_points(HALF, points // OBJECTS, generator) for _ in range(size * OBJECTS)]
    cloud = torch.from_numpy(np.stack(clouds)).float().view(size, OBJECTS, -1, 3)
    cloud = (cloud + T[:, :, None, :3, 3]).flatten(1, 2)
    seed_index = farthest_points(cloud, seeds)
    near = cloud.gather(1, seed_index[:, :labels, None].expand(-1, -1, 3))
    match = torch.zeros(size, seeds, labels, dtype=torch.bool)
    match[:, range(labels), range(labels)] = True
    return Batch(
        points=cloud,
        seed_index=seed_index,
        grasp_position=near + 0.05 * torch.randn_like(near),
        grasp_rotation=random_rotations(size * labels).view(size, labels, 3, 3),
        grasp_joints=torch.rand(size, labels, dofs),
        grasp_mask=torch.ones(size, labels, dtype=torch.bool),
        match=match,
        object_index=torch.arange(OBJECTS).repeat(size, 1),
        T_world_object=T,
        scene_number=torch.arange(size),
    )


def module_of(
    stage: Stage,
    hand: HandModel,
    network: NetworkConfig | None = None,
    losses: LossConfig = LOSSES,
    **training: Any,
) -> GraspTraining:
    """A stage's training of a fresh network on four boxes."""
    torch.manual_seed(0)
    config = TrainingConfig(**training)
    grid = box_grid(HALF, 0.03)
    atlas = ObjectAtlas.of([Box(f"box/{i}", grid, np.zeros(3)) for i in range(OBJECTS)])
    task = Task(stage, losses, hand, atlas, config.rank_points)
    net = new_network(network or NetworkConfig(), hand)
    return GraspTraining(net, task, config, Path("failure.pt"))
