"""Training steps with the Shadow Hand: 4 scenes, 4 objects each, all terms, 64 hard samples.

The data are boxes and random labels; a network fresh from its start has hands that collide.
"""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest
import torch

from dmfc.config.hand import HandConfig
from dmfc.config.losses import LossConfig, LossWeights, Q1Config
from dmfc.config.network import NetworkConfig
from dmfc.config.training import TrainingConfig
from dmfc.geometry.points import farthest_points
from dmfc.geometry.rotations import random_rotations
from dmfc.hand.build import build_hand
from dmfc.hand.model import HandModel
from dmfc.losses.atlas import ObjectAtlas
from dmfc.training.module import GraspTraining
from dmfc.training.task import Task
from dmfc.training.weights import new_network
from tests.training.toy import Box, box_grid, box_points

OBJECTS, LABELS = 4, 256
LOSSES = LossConfig(weights=LossWeights(1.0, 1.0, 1.0, 1.0, 1.0), q1=Q1Config(directions=728))


@pytest.fixture(scope="module")
def hand(shadow_hand_dir: Path) -> HandModel:
    return build_hand(HandConfig())


def batch_of(size: int, dofs: int) -> dict[str, torch.Tensor]:
    generator = np.random.default_rng(0)
    torch.manual_seed(0)
    half = np.array([0.04, 0.03, 0.06])
    place = np.array([[-0.1, -0.1], [0.1, -0.1], [-0.1, 0.1], [0.1, 0.1]])
    T = torch.eye(4).repeat(size, OBJECTS, 1, 1)
    T[..., :2, 3] = torch.from_numpy(place).float()
    T[..., 2, 3] = half[2]
    clouds = [box_points(half, 2048 // OBJECTS, generator) for _ in range(size * OBJECTS)]
    points = torch.from_numpy(np.stack(clouds)).float().view(size, OBJECTS, -1, 3)
    points = (points + T[:, :, None, :3, 3]).flatten(1, 2)
    seeds = farthest_points(points, 512)
    near = points.gather(1, seeds[:, :LABELS, None].expand(-1, -1, 3))
    match = torch.zeros(size, 512, LABELS, dtype=torch.bool)
    match[:, range(LABELS), range(LABELS)] = True
    return {
        "points": points,
        "seed_index": seeds,
        "grasp_position": near + 0.05 * torch.randn_like(near),
        "grasp_rotation": random_rotations(size * LABELS).view(size, LABELS, 3, 3),
        "grasp_joints": torch.rand(size, LABELS, dofs),
        "match": match,
        "object_index": torch.arange(OBJECTS).repeat(size, 1),
        "T_world_object": T,
        "scene": torch.arange(size),
    }


def atlas() -> ObjectAtlas:
    grid = box_grid(np.array([0.04, 0.03, 0.06]), 0.03)
    return ObjectAtlas.of([Box(f"box/{i}", grid, np.zeros(3)) for i in range(OBJECTS)])


def module_of(stage, hand: HandModel, losses=LOSSES, **training) -> GraspTraining:
    torch.manual_seed(0)
    config = TrainingConfig(**training)
    task = Task(stage, losses, hand, atlas(), config.rank_points)
    return GraspTraining(new_network(NetworkConfig(), hand), task, config, Path("failure.pt"))


@pytest.mark.benchmark(group="training step, 4 scenes")
@pytest.mark.parametrize("stage", ["pretrain", "finetune"])
def test_step(benchmark, hand, stage):
    module, batch = module_of(stage, hand), batch_of(4, hand.dofs)
    optimizer = module.configure_optimizers()

    def step():
        optimizer.zero_grad()
        module.training_step(batch, 0).backward()
        optimizer.step()

    benchmark.pedantic(step, rounds=7, warmup_rounds=1)


@pytest.mark.benchmark(group="parts of the fine-tuning step")
@pytest.mark.parametrize("part", ["rank", "terms"])
def test_parts(benchmark, hand, part):
    module, batch = module_of("finetune", hand), batch_of(4, hand.dofs)
    rows = module.task.candidates(module.net(batch["points"], batch["seed_index"]), batch)
    rows = dataclasses.replace(
        rows,
        **{name: getattr(rows, name).detach() for name in ("position", "rotation6d", "joints")},
    )
    few = rows.take(torch.arange(64))
    few.position.requires_grad_()
    few.joints.requires_grad_()

    def terms():
        sum(v.sum() for n, v in module.task.terms(few, batch).items() if n != "chamfer").backward()

    run = terms if part == "terms" else lambda: module.task.errors(rows, batch)
    benchmark.pedantic(run, rounds=7, warmup_rounds=1)
