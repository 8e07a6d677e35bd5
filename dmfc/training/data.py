"""Training batches of scenes: augmented, with seed points, and with the labels that match them.

Needs neither a simulator nor mesh tools. The order of the scenes in epoch e and what augmentation
does to a scene in it depend on (seed, e) alone: not on workers, nor on the epochs before.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import lightning
import numpy as np
import torch
from torch import Tensor
from torch.utils.data import DataLoader, Dataset, Sampler

from dmfc.config.scenes import AugmentationConfig, CameraConfig, MatchingConfig, ScenesConfig
from dmfc.errors import DmfcError
from dmfc.geometry import transforms
from dmfc.geometry.points import farthest_points
from dmfc.grasps.grasp_set import GraspSet
from dmfc.scenes.augment import kept_points, random_motion, sensor_errors
from dmfc.scenes.matching import ObservedPoints, match_grasps
from dmfc.scenes.scene_grasps import grasps_in_scene
from dmfc.scenes.scene_set import Scene, SceneSet
from dmfc.sensing.cameras import table_cameras
from dmfc.training.batch import Batch, SceneItem, collate

_AUGMENT, _SHUFFLE = range(2)  # independent random streams of one seed


class SceneDataset(Dataset):
    """Scenes as tensors; an item is asked for as (epoch, position), or position for epoch 0.

    `object_index` of an item points into `object_order`.
    """

    def __init__(
        self,
        scenes: Sequence[Scene],
        grasps: Mapping[str, GraspSet],
        object_order: Sequence[str],
        palm_reference: np.ndarray,
        matching: MatchingConfig,
        cameras: CameraConfig,
        augmentation: AugmentationConfig | None = None,
        num_seeds: int = 512,
        seed: int = 0,
    ) -> None:
        self.scenes = scenes
        self._grasps = grasps
        self._rows = {object_id: row for row, object_id in enumerate(object_order)}
        self._palm_reference = np.asarray(palm_reference, dtype=np.float64)
        self._matching = matching
        self._positions = np.stack([camera.position for camera in table_cameras(cameras)])
        self._augmentation = augmentation
        self._num_seeds = num_seeds
        self._seed = seed

    def __len__(self) -> int:
        return len(self.scenes)

    def __getitem__(self, key: int | tuple[int, int]) -> SceneItem:
        """Raises DmfcError if the scene holds an object that is not in `object_order`."""
        epoch, position = key if isinstance(key, tuple) else (0, key)
        scene = self.scenes[position]
        points, normals = scene.points.astype(np.float64), scene.normals.astype(np.float64)
        point_object, T_world_object = scene.point_object, scene.T_world_object
        if self._augmentation is not None:
            words = np.random.SeedSequence(self._seed, spawn_key=(_AUGMENT, epoch, position))
            generator = np.random.default_rng(words)
            points, normals = sensor_errors(
                self._augmentation, points, normals, scene.point_camera, self._positions, generator
            )
            kept = kept_points(self._augmentation, len(points), generator)
            points, normals, point_object = points[kept], normals[kept], point_object[kept]
            T_new_world = random_motion(self._augmentation, generator)
            points = transforms.apply(T_new_world, points)
            normals = transforms.rotate(T_new_world, normals)
            T_world_object = T_new_world @ T_world_object
        points = points.astype(np.float32)
        seed_index = farthest_points(points, self._num_seeds)
        seeds = ObservedPoints.of(ObservedPoints(points, normals, point_object), seed_index)
        rows = [self._row(scene, object_id) for object_id in scene.object_ids]
        return SceneItem(
            points=torch.from_numpy(points),
            seed_index=torch.from_numpy(seed_index),
            **self._labels(scene, T_world_object, seeds),
            object_index=torch.tensor(rows, dtype=torch.int64),
            T_world_object=torch.from_numpy(T_world_object.astype(np.float32)),
            scene_number=torch.tensor(scene.scene),
        )

    def _labels(
        self, scene: Scene, T_world_object: np.ndarray, seeds: ObservedPoints
    ) -> dict[str, Tensor]:
        """The grasps that match a seed point, and the table of matches."""
        grasps = grasps_in_scene(
            scene.object_ids,
            T_world_object,
            scene.grasp_object,
            scene.grasp_index,
            self._grasps,
            self._palm_reference,
        )
        match = match_grasps(self._matching, seeds, grasps)
        used = match.any(0)
        return {
            "grasp_position": torch.from_numpy(grasps.position[used].astype(np.float32)),
            "grasp_rotation": torch.from_numpy(grasps.rotation[used].astype(np.float32)),
            "grasp_joints": torch.from_numpy(grasps.joints[used].astype(np.float32)),
            "match": torch.from_numpy(match[:, used]),
        }

    def _row(self, scene: Scene, object_id: str) -> int:
        if object_id not in self._rows:
            raise DmfcError(
                f"scene {scene.scene} holds '{object_id}', which is not among the "
                f"{len(self._rows)} objects given (setting objects.train)"
            )
        return self._rows[object_id]


class EpochSampler(Sampler[tuple[int, int]]):
    """Keys (epoch, position) in an order that depends on (seed, epoch) alone.

    Lightning calls `set_epoch`. With several processes each takes every `world_size`-th key.
    """

    def __init__(
        self, count: int, seed: int, shuffle: bool = True, rank: int = 0, world_size: int = 1
    ) -> None:
        self._count = count
        self._seed = seed
        self._shuffle = shuffle
        self._rank, self._world_size = rank, world_size
        self._epoch = 0

    def set_epoch(self, epoch: int) -> None:
        self._epoch = epoch

    def __len__(self) -> int:
        return -(-self._count // self._world_size)

    def __iter__(self) -> Iterator[tuple[int, int]]:
        order = np.arange(self._count)
        if self._shuffle:
            words = np.random.SeedSequence(self._seed, spawn_key=(_SHUFFLE, self._epoch))
            order = np.random.default_rng(words).permutation(self._count)
        padded = np.resize(order, len(self) * self._world_size)  # all processes take as many steps
        return ((self._epoch, int(position)) for position in padded[self._rank :: self._world_size])


class SceneData(lightning.LightningDataModule):
    """Training scenes (augmented, shuffled) and, if given, validation scenes (as they are).

    `object_order` is the order of the objects in the caller's atlas: `object_index` points into it.
    For several devices, make the Trainer with use_distributed_sampler=False.
    """

    def __init__(
        self,
        config: ScenesConfig,
        matching: MatchingConfig,
        train: SceneSet,
        grasps: Mapping[str, GraspSet],
        object_order: Sequence[str],
        palm_reference: np.ndarray,
        *,
        batch_size: int = 4,
        workers: int = 0,
        seed: int = 0,
        num_seeds: int = 512,
        validation: SceneSet | None = None,
    ) -> None:
        super().__init__()
        shared = (grasps, object_order, palm_reference, matching, config.cameras)
        # even a new order of the points would draw other seeds
        added = None if config.augmentation.nothing else config.augmentation
        self.train = SceneDataset(train, *shared, added, num_seeds=num_seeds, seed=seed)
        self.validation = (
            SceneDataset(validation, *shared, num_seeds=num_seeds, seed=seed)
            if validation
            else None
        )
        self._batch_size, self._workers, self._seed = batch_size, workers, seed

    def probe(self, count: int) -> Batch:
        """The first training scenes, `count` at most, as the first epoch shows them."""
        return collate([self.train[0, i] for i in range(min(count, len(self.train)))])

    def train_dataloader(self) -> DataLoader:
        return self._loader(self.train, shuffle=True)

    def val_dataloader(self) -> DataLoader | list:
        return self._loader(self.validation, shuffle=False) if self.validation else []

    def _loader(self, dataset: SceneDataset, shuffle: bool) -> DataLoader:
        trainer = self.trainer
        rank, world = (trainer.global_rank, trainer.world_size) if trainer else (0, 1)
        sampler = EpochSampler(len(dataset), self._seed, shuffle, rank, world)
        return DataLoader(
            dataset,
            batch_size=self._batch_size,
            sampler=sampler,
            collate_fn=collate,
            num_workers=self._workers,
            persistent_workers=self._workers > 0,
        )
