"""A two-fingered hand, two boxes and scenes of them, small enough to train on in seconds."""

from __future__ import annotations

from dataclasses import dataclass

import lightning
import numpy as np
import torch
from torch.utils.data import DataLoader

from dmfc.config.closing import ClosingConfig
from dmfc.config.network import NetworkConfig
from dmfc.geometry.grid import Grid
from dmfc.geometry.points import farthest_points
from dmfc.geometry.rotations import matrix_from_6d
from dmfc.hand.model import HandModel
from dmfc.objects.atlas import ObjectAtlas
from dmfc.training.batch import Batch, SceneItem, collate
from dmfc.training.data import EpochSampler

SEEDS = 32
NETWORK = NetworkConfig(
    levels=[SEEDS, 16, 8],
    radii=[0.03, 0.06, 0.12],
    neighbours=[8, 8, 8],
    abstraction=[[16, 32], [32, 32], [32, 64]],
    global_widths=[64],
    propagation=[[64], [32], [32]],
    features=32,
    width=32,
    offset_to="origin",
)
HALF = np.array([0.03, 0.02, 0.04])


def box_distance(points: np.ndarray, half: np.ndarray) -> np.ndarray:
    """Signed distance to a box about the origin, positive inside."""
    q = np.abs(points) - half
    return -np.linalg.norm(np.maximum(q, 0), axis=1) - np.minimum(q.max(1), 0)


def box_grid(half: np.ndarray, margin: float = 0.02) -> Grid:
    reach = half + margin
    return Grid.sample(lambda p: box_distance(p, half), -reach, reach, 0.005)


def box_points(half: np.ndarray, count: int, generator: np.random.Generator) -> np.ndarray:
    points = generator.uniform(-1, 1, (count, 3))
    face = generator.integers(0, 3, count)
    points[np.arange(count), face] = np.sign(points[np.arange(count), face])
    return points * half


def toy_hand() -> HandModel:
    """A palm with two fingers along z that turn about x, towards each other."""
    halves = [np.array([0.03, 0.03, 0.01]), *[np.array([0.01, 0.005, 0.03])] * 2]
    generator = np.random.default_rng(0)
    points = [box_points(half, 20, generator) for half in halves]
    T = np.tile(np.eye(4), (3, 1, 1))
    T[1, :3, 3], T[2, :3, 3] = [0, 0.04, 0.02], [0, -0.04, 0.02]
    return HandModel(
        name="toy",
        dof_names=["left", "right"],
        lower=np.array([-0.3, -0.3]),
        upper=np.array([0.9, 0.9]),
        open_joints=np.zeros(2),
        flexion=np.ones(2),
        closing=ClosingConfig(opening=0.0, squeeze=0.0),
        link_names=["palm", "left", "right"],
        parents=np.array([-1, 0, 0]),
        T_parent_link=T,
        joint_axis=np.array([[0, 0, 0], [1, 0, 0], [-1, 0, 0]], dtype=float),
        joint_dof=np.array([-1, 0, 1]),
        joint_scale=np.array([0.0, 1.0, 1.0]),
        palm_reference=np.array([0, 0, 0.01]),
        palm_normal=np.array([0.0, 0, 1]),
        collision_link=np.repeat(np.arange(3), 20),
        collision_points=np.concatenate(points),
        inner_link=np.array([0, 1, 1, 2, 2]),
        inner_points=np.array(
            [[0, 0, 0.01], [0, -0.005, 0.01], [0, -0.005, 0.02], [0, 0.005, 0.01], [0, 0.005, 0.02]]
        ),
        inner_normals=np.array([[0, 0, 1], [0, -1, 0], [0, -1, 0], [0, 1, 0], [0, 1, 0]], float),
        adjacency=np.array([[1, 1, 1], [1, 1, 0], [1, 0, 1]], dtype=bool),
        link_grids=[box_grid(half) for half in halves],
        link_vertices=[np.zeros((0, 3))] * 3,
        link_faces=[np.zeros((0, 3), np.int32)] * 3,
    )


@dataclass(frozen=True)
class Box:
    id: str
    sdf: Grid
    com: np.ndarray


def toy_atlas() -> ObjectAtlas:
    return ObjectAtlas.of(
        [Box(f"toy/{i}", box_grid(HALF * (1 + i)), np.zeros(3)) for i in range(2)]
    )


def toy_scene(number: int) -> SceneItem:
    """A box on the table, one or two grasps from above per seed on its upper half, as an item."""
    generator = np.random.default_rng(number)
    which = number % 2
    half = HALF * (1 + which)
    T = np.eye(4)
    T[:3, 3] = [*generator.uniform(-0.1, 0.1, 2), half[2]]
    points = (box_points(half, 128, generator) + T[:3, 3]).astype(np.float32)
    seeds = farthest_points(points, SEEDS)
    top = points[seeds][:, 2] > half[2]
    count = int(top.sum())
    tilt = torch.from_numpy(generator.normal(0, 0.1, (count, 3))).float()
    down = matrix_from_6d(
        torch.tensor([1.0, 0, 0]).expand(count, 3) + tilt,
        torch.tensor([0, -1.0, 0]).expand(count, 3),
    )
    position = points[seeds][top] + [0.0, 0.0, 0.05]
    match = np.zeros((SEEDS, count), dtype=bool)
    match[np.flatnonzero(top), np.arange(count)] = True
    match[np.flatnonzero(top), (np.arange(count) + 1) % count] = True
    return SceneItem(
        points=torch.from_numpy(points),
        seed_index=torch.from_numpy(seeds),
        grasp_position=torch.from_numpy(position.astype(np.float32)),
        grasp_rotation=down,
        grasp_joints=torch.from_numpy(generator.uniform(0.1, 0.5, (count, 2)).astype(np.float32)),
        match=torch.from_numpy(match),
        object_index=torch.tensor([which]),
        T_world_object=torch.from_numpy(T.astype(np.float32))[None],
        scene_number=torch.tensor(100 + number),
    )


def toy_batch(count: int = 4) -> Batch:
    return collate([toy_scene(i) for i in range(count)])


class _Items(torch.utils.data.Dataset):
    def __init__(self, items: list[SceneItem]) -> None:
        self.items = items

    def __len__(self) -> int:
        return len(self.items)

    def __getitem__(self, key: tuple[int, int]) -> SceneItem:
        return self.items[key[1]]


class ToyData(lightning.LightningDataModule):
    """`count` scenes in batches of 4, in an order of (seed, epoch)."""

    def __init__(self, count: int = 8, change=None, validation: bool = False) -> None:
        super().__init__()
        self.items = [toy_scene(i) for i in range(count)]
        self.with_validation = validation
        if change is not None:
            change(self.items)

    def train_dataloader(self) -> DataLoader:
        sampler = EpochSampler(len(self.items), seed=0)
        return DataLoader(_Items(self.items), batch_size=4, sampler=sampler, collate_fn=collate)

    def val_dataloader(self) -> DataLoader | list:
        return self.train_dataloader() if self.with_validation else []
