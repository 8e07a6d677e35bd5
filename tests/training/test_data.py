"""Training batches: contents, matching, augmentation, order."""

from __future__ import annotations

import dataclasses
import subprocess
import sys

import lightning
import numpy as np
import pytest
import torch

from dmfc.config.scenes import AugmentationConfig, CameraConfig, MatchingConfig
from dmfc.errors import DmfcError
from dmfc.geometry.points import farthest_points
from dmfc.scenes.augment import depth_noise, kept_points, random_motion
from dmfc.scenes.scene_set import SceneSet
from dmfc.training.batch import SceneItem, collate
from dmfc.training.data import EpochSampler, SceneData, SceneDataset

MATCHING = MatchingConfig(mode="projected", distance=0.01)
STILL = AugmentationConfig(shift=0.0, noise=0.0, dropped=0.0)


@pytest.fixture
def dataset(scenes, grasps, objects, hand):
    def make(augmentation=None, order=None, seed=0, matching=MATCHING):
        names = list(objects) if order is None else order
        return SceneDataset(
            scenes,
            grasps,
            names,
            hand.palm_reference,
            matching,
            CameraConfig(),
            augmentation,
            num_seeds=512,
            seed=seed,
        )

    return make


def test_batch_is_as_agreed(dataset, scenes, objects):
    batch = collate([dataset()[i] for i in range(4)])
    count, most = batch.grasp_mask.shape
    widest = max(len(scene.object_ids) for scene in scenes[:4])
    expected = {
        "points": ((4, 2048, 3), torch.float32),
        "seed_index": ((4, 512), torch.int64),
        "grasp_position": ((4, most, 3), torch.float32),
        "grasp_rotation": ((4, most, 3, 3), torch.float32),
        "grasp_joints": ((4, most, 1), torch.float32),
        "grasp_mask": ((4, most), torch.bool),
        "match": ((4, 512, most), torch.bool),
        "object_index": ((4, widest), torch.int64),
        "T_world_object": ((4, widest, 4, 4), torch.float32),
        "scene_number": ((4,), torch.int64),
    }
    assert {k: (tuple(v.shape), v.dtype) for k, v in batch.tensors().items()} == expected
    assert count == 4
    assert batch.match.any(1).equal(batch.grasp_mask)  # those that match, and only those
    for row, scene in enumerate(scenes[:4]):
        ids = [list(objects)[k] for k in batch.object_index[row] if k >= 0]
        assert ids == scene.object_ids
        T = batch.T_world_object[row].numpy()
        assert np.allclose(T[: len(ids)], scene.T_world_object, atol=1e-6)
        assert np.allclose(T[len(ids) :], np.eye(4))


def test_a_batch_moves_as_a_whole(dataset):
    batch = collate([dataset()[0]])
    moved = batch.to("meta")
    assert len(moved) == len(batch) == 1
    assert {tensor.device.type for tensor in moved.tensors().values()} == {"meta"}
    shapes = {name: tensor.shape for name, tensor in batch.tensors().items()}
    assert {name: tensor.shape for name, tensor in moved.tensors().items()} == shapes


def test_matches_hold_in_the_batch(dataset, hand):
    """Every match: the label's palm is in front of the seed (paper's d_n); its hit is near."""
    item = dataset()[0]
    seeds = item.points[item.seed_index]
    i, g = item.match.nonzero(as_tuple=True)
    assert len(i) > 10
    inward = item.grasp_rotation[:, :, 2]
    reference = item.grasp_position + item.grasp_rotation @ torch.tensor(
        hand.palm_reference, dtype=torch.float32
    )
    beside = torch.linalg.cross(seeds[i] - reference[g], inward[g]).norm(dim=1)
    assert beside.max() <= 0.01 + 1e-6  # the hit lies on the palm's axis
    assert item.match.any(0).all()


def test_scene_without_a_match_keeps_the_batch_whole(dataset):
    """With an impossible matching distance there is one padded grasp, and no mask set."""
    nothing = dataset(matching=MatchingConfig(mode="projected", distance=0.0))
    batch = collate([nothing[0], nothing[1]])
    assert batch.match.shape == (2, 512, 1)
    assert not batch.grasp_mask.any()
    assert torch.isfinite(batch.grasp_rotation).all()


def test_turning_the_scene_turns_everything(dataset, scenes):
    """Points, labels and object poses of an augmented item are those of the plain one, turned."""
    still = dataset(dataclasses.replace(STILL, yaw=False))
    turned = dataset(STILL)
    for position in range(3):
        plain, other = still[3, position], turned[3, position]
        T_new_world = other.T_world_object[0] @ torch.linalg.inv(plain.T_world_object[0])
        turn = T_new_world[:3, :3]
        assert not torch.allclose(turn, torch.eye(3), atol=1e-3)
        assert torch.allclose(turn[2], torch.tensor([0.0, 0.0, 1.0]), atol=1e-5)
        assert torch.allclose(other.points, plain.points @ turn.T, atol=1e-5)
        assert torch.allclose(other.T_world_object, T_new_world @ plain.T_world_object, atol=1e-5)
        if torch.equal(other.seed_index, plain.seed_index):
            assert torch.equal(other.match, plain.match)
            position_turned = plain.grasp_position @ turn.T
            assert torch.allclose(other.grasp_position, position_turned, atol=1e-5)
            rotation_turned = turn @ plain.grasp_rotation
            assert torch.allclose(other.grasp_rotation, rotation_turned, atol=1e-5)
            assert torch.equal(other.grasp_joints, plain.grasp_joints)


def test_without_augmentation_an_item_is_the_scene(dataset, scenes):
    item = dataset()[2]
    assert (item.points.numpy() == scenes[2].points).all()
    assert (item.seed_index.numpy() == farthest_points(scenes[2].points, 512)).all()


def test_augmentation_depends_on_seed_and_epoch_alone(dataset):
    config = AugmentationConfig()
    first, again, other = dataset(config), dataset(config), dataset(config, seed=1)
    first[0, 1], first[1, 2]
    assert torch.equal(first[5, 0].points, again[5, 0].points)
    assert not torch.equal(first[5, 0].points, first[6, 0].points)
    assert not torch.equal(first[5, 0].points, other[5, 0].points)


def test_noise_is_along_the_ray_with_the_given_deviation():
    generator = np.random.default_rng(0)
    rays = generator.normal(size=(20_000, 3))
    noise = depth_noise(AugmentationConfig(noise=0.002), rays, generator)
    assert np.abs(np.cross(noise, rays)).max() < 1e-12
    assert np.linalg.norm(noise, axis=1).std() == pytest.approx(0.002 * 0.603, rel=0.02)
    signed = (noise * rays).sum(1) / np.linalg.norm(rays, axis=1)
    assert signed.std() == pytest.approx(0.002, rel=0.02)


def test_dropped_points_are_replaced_by_repeats():
    kept = kept_points(AugmentationConfig(dropped=0.25), 2048, np.random.default_rng(0))
    assert len(kept) == 2048
    assert len(np.unique(kept)) == 1536
    whole = kept_points(AugmentationConfig(dropped=0.0), 2048, np.random.default_rng(0))
    assert len(np.unique(whole)) == 2048


def test_motion_is_about_the_vertical_and_within_bounds():
    for seed in range(20):
        T = random_motion(AugmentationConfig(shift=0.02), np.random.default_rng(seed))
        assert np.abs(T[:2, 3]).max() <= 0.02
        assert T[2, 3] == 0
        assert np.allclose(T[2, :3], [0, 0, 1])
        assert np.isclose(np.linalg.det(T[:3, :3]), 1)


def test_order_depends_on_seed_and_epoch():
    sampler = EpochSampler(10, seed=3)
    sampler.set_epoch(4)
    again = EpochSampler(10, seed=3)
    again.set_epoch(4)
    assert list(sampler) == list(again)
    assert sorted(position for _, position in sampler) == list(range(10))
    assert {epoch for epoch, _ in sampler} == {4}
    again.set_epoch(5)
    assert [p for _, p in again] != [p for _, p in sampler]
    assert list(EpochSampler(3, 0, shuffle=False)) == [(0, 0), (0, 1), (0, 2)]


def test_processes_share_an_epoch():
    parts = [list(EpochSampler(10, 0, rank=rank, world_size=4)) for rank in range(4)]
    assert {len(part) for part in parts} == {3}
    assert {position for part in parts for _, position in part} == set(range(10))


def test_object_that_is_not_in_the_atlas_is_named(dataset):
    with pytest.raises(DmfcError, match="is not among the 1 objects given"):
        dataset(order=["shape/none"])[0]


class _Recorder(lightning.LightningModule):
    """Notes what the batches hold, and learns nothing."""

    def __init__(self) -> None:
        super().__init__()
        self.weight = torch.nn.Parameter(torch.zeros(()))
        self.seen: list[tuple[int, list[int], float]] = []

    def training_step(self, batch, index):
        total = float(batch.points.double().sum())
        self.seen.append((self.current_epoch, batch.scene_number.tolist(), total))
        return self.weight

    def configure_optimizers(self):
        return torch.optim.SGD(self.parameters(), lr=0.1)


@pytest.mark.filterwarnings(
    "ignore::UserWarning", "ignore::lightning.pytorch.utilities.warnings.PossibleUserWarning"
)
def test_lightning_runs_epochs_alike_with_any_number_of_workers(
    tmp_path, config, objects, grasps, hand, shards
):
    seen = []
    for workers in (0, 2):
        data = SceneData(
            config,
            MATCHING,
            SceneSet.open(shards),
            grasps,
            list(objects),
            hand.palm_reference,
            batch_size=3,
            workers=workers,
            validation=SceneSet.open(shards[:1]),
        )
        assert [batch.scene_number.tolist() for batch in data.val_dataloader()] == [[0, 1, 2]]
        model = _Recorder()
        trainer = lightning.Trainer(
            max_epochs=2,
            accelerator="cpu",
            logger=False,
            enable_checkpointing=False,
            enable_progress_bar=False,
            enable_model_summary=False,
            limit_val_batches=0,
        )
        trainer.fit(model, datamodule=data)
        seen.append(model.seen)
    assert seen[0] == seen[1]
    epochs = [[s for e, batch, _ in seen[0] if e == epoch for s in batch] for epoch in (0, 1)]
    assert sorted(epochs[0]) == sorted(epochs[1]) == list(range(7))
    assert epochs[0] != epochs[1]


def test_with_augmentation_off_every_epoch_has_the_same_clouds_and_seeds(
    config, scenes, grasps, objects, hand
):
    off = dataclasses.replace(STILL, yaw=False, camera_shift=0.0, camera_turn=0.0)
    items = {}
    for name, added in (("off", off), ("moved", dataclasses.replace(off, shift=0.01))):
        given = dataclasses.replace(config, augmentation=added)
        data = SceneData(given, MATCHING, scenes, grasps, list(objects), hand.palm_reference)
        items[name] = [data.train[epoch, 0] for epoch in (0, 1)]
    for entry in dataclasses.fields(SceneItem):
        first, second = (getattr(item, entry.name) for item in items["off"])
        assert torch.equal(first, second), entry.name
    assert not torch.equal(*(item.seed_index for item in items["moved"]))


def test_import_needs_no_simulator_or_mesh_tools():
    code = (
        "import sys; "
        "absent = 'mujoco trimesh fcl embreex igl ray mlflow coacd'.split(); "
        "sys.modules.update(dict.fromkeys(absent)); "  # importing one of them raises ImportError
        "import dmfc.training.data; print(dmfc.training.data.SceneData.__name__)"
    )
    shown = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert shown.stdout.strip() == "SceneData"
