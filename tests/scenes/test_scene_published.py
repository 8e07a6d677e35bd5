"""A scene set as one folder, here or at a URL, and the user's own clouds in one."""

from __future__ import annotations

import json

import fsspec
import numpy as np
import pytest
import torch
import trimesh

from dmfc.assets.packs import get_pack
from dmfc.config.network import NetworkConfig
from dmfc.config.scenes import CameraConfig, MatchingConfig, ScenesConfig
from dmfc.errors import DmfcError
from dmfc.network.checkpoint import new_network
from dmfc.network.inference import predict
from dmfc.scenes.custom import cloud_scene, import_clouds, read_cloud
from dmfc.scenes.publish.published import PublishedSet, packs_of, publish
from dmfc.training.batch import collate
from dmfc.training.data import SceneDataset


@pytest.fixture(scope="module")
def files(tmp_path_factory, shards, grasps):
    """Shards and grasp sets as stages leave them."""
    folder = tmp_path_factory.mktemp("made")
    sets = {name: folder / f"{name.replace('/', '-')}.grasps" for name in grasps}
    for name, path in sets.items():
        grasps[name].save(path)
    return shards, sets


@pytest.mark.parametrize("copy", [True, False])
def test_a_folder(tmp_path, files, scenes, grasps, hand, copy):
    place = str(tmp_path / "set")
    publish(place, *files, hand.palm_reference, MatchingConfig(), copy=copy, made_by={"by": "me"})
    same_set(PublishedSet.open(place), scenes, grasps, hand)
    assert (tmp_path / "set" / "shards").exists() == copy


def test_an_object_store(files, scenes, grasps, hand):
    """fsspec's file system in memory stands for one; the same code reads s3:// and https://."""
    place = "memory://bucket/set"
    publish(place, *files, hand.palm_reference, MatchingConfig(), copy=True, made_by={})
    found = PublishedSet.open(place)
    same_set(found, scenes, grasps, hand)
    memory = fsspec.filesystem("memory")
    memory.pipe("/bucket/set/shards/00001.parquet", files[0][1].read_bytes()[:-7])
    memory.rm("/bucket/set/grasps/shape__box.parquet")
    assert found.damaged() == ["shards/00001.parquet", "grasps/shape__box.parquet"]
    with pytest.raises(DmfcError, match=r"00001\.parquet is damaged or cut short"):
        _ = PublishedSet.open(place).scenes


def same_set(found, scenes, grasps, hand):
    assert len(found.scenes) == len(scenes)
    assert found.scenes[4].object_ids == scenes[4].object_ids
    assert np.abs(found.scenes[6].points - scenes[6].points).max() < 2e-5
    assert (found.palm_reference == hand.palm_reference).all()
    assert found.damaged() == []
    manifest = found.manifest
    assert set(manifest["objects"]) == {name for scene in scenes for name in scene.object_ids}
    for name in manifest["objects"]:
        assert np.allclose(found.grasps[name].position, grasps[name].position, atol=1e-6)
    assert manifest["set"]["seed"] == 0
    assert manifest["statistics"]["grasps"] == sum(len(scene.grasp_index) for scene in scenes)
    assert manifest["statistics"]["dropped"]["table"] > 0
    assert [shard["scenes"] for shard in manifest["shards"]] == [[0, 3], [3, 6], [6, 7]]


def test_a_manifest_names_the_packs():
    found = packs_of({"ycb/mug": "", "procedural/box-0000": "", "random/3": ""})
    assert found == {name: get_pack(name).sha256 for name in ("ycb", "random")}
    assert list(packs_of(["procedural/box-0000"], "shadow_hand")) == ["shadow_hand"]


def test_what_is_no_set_is_told_in_one_line(tmp_path):
    for place, why in (
        (str(tmp_path), r"manifest\.json cannot be read"),
        ("nowhere://bucket", "nothing here opens nowhere://bucket"),
    ):
        with pytest.raises(DmfcError, match=why) as caught:
            PublishedSet.open(place)
        assert "\n" not in str(caught.value)
    (tmp_path / "manifest.json").write_text(json.dumps({"kind": "other"}))
    with pytest.raises(DmfcError, match="no scene set of version 2"):
        PublishedSet.open(str(tmp_path))


@pytest.mark.parametrize("suffix", [".npy", ".ply", ".xyz", ".csv"])
def test_own_clouds_of_any_kind(tmp_path, suffix):
    points = np.random.default_rng(0).normal(size=(40, 3))
    path = tmp_path / f"cloud{suffix}"
    if suffix == ".npy":
        np.save(path, np.concatenate([points, np.full((2, 3), np.nan)]))
    elif suffix == ".ply":
        trimesh.PointCloud(points).export(path)
    else:
        np.savetxt(path, points, delimiter="," if suffix == ".csv" else " ")
    assert np.allclose(read_cloud(path, "cm"), points / 100, atol=1e-7)


def test_errors_of_own_clouds(tmp_path):
    for name, content, why in (
        ("a.pcd", "", "no cloud file"),
        ("b.xyz", "1 2\n", "not points x y z"),
        ("c.xyz", "one two three\n", "cannot be read"),
    ):
        (tmp_path / name).write_text(content)
        with pytest.raises(DmfcError, match=why):
            read_cloud(tmp_path / name)
    with pytest.raises(DmfcError, match="unknown unit 'feet'"):
        read_cloud(tmp_path / "b.xyz", "feet")
    with pytest.raises(DmfcError, match="at least 16"):
        cloud_scene(np.zeros((3, 3)), 0, ScenesConfig())


@pytest.mark.parametrize(
    ("scale", "above", "why"),
    [
        ([1000, 1000, 1000], -1.0, r"mine\.npy: it reaches 100 m from the table's centre.*--unit"),
        ([1, 1, -1], -1.0, r"mine\.npy: it reaches 0\.05 m below the table top"),
        ([1, 1, -1], 0.01, r"mine\.npy: it has no points there"),
    ],
)
def test_a_cloud_that_is_not_on_the_table_is_refused(tmp_path, scale, above, why):
    """In another unit, or in the frame of a camera that looks down."""
    corners = np.array([[x, y, z] for x in (-0.1, 0.1) for y in (0, 0.1) for z in (0, 0.05)])
    np.save(tmp_path / "mine.npy", np.repeat(corners, 4, axis=0))
    out = tmp_path / "scenes.parquet"
    assert import_clouds([tmp_path / "mine.npy"], out, ScenesConfig(points=64)) == 1
    np.save(tmp_path / "mine.npy", np.repeat(corners, 4, axis=0) * scale)
    with pytest.raises(DmfcError, match=why):
        import_clouds([tmp_path / "mine.npy"], out, ScenesConfig(points=64), above=above)


def test_normals_of_an_own_cloud_point_out():
    """Also where the nearest camera is not the one that sees a face: a box beside the centre."""
    box = trimesh.creation.box((0.06, 0.09, 0.12))
    box.apply_translation([0.12, 0.03, 0.06])
    points, face = trimesh.sample.sample_surface(box, 6000, seed=0)
    seen = points[box.face_normals[face][:, 2] > -0.5]
    scene = cloud_scene(seen, 0, ScenesConfig())
    _, distance, face = trimesh.proximity.closest_point(box, scene.points)
    cosine = (scene.normals * box.face_normals[face]).sum(1)
    assert distance.max() < 1e-6
    assert (cosine > 0.9).mean() > 0.9  # not within a neighbourhood of an edge
    assert (cosine < -0.5).mean() < 0.01


def test_an_own_cloud_goes_through_loader_and_network(hand, tmp_path):
    ball = trimesh.creation.icosphere(4, 0.05)
    ball.apply_translation([0, 0, 0.05])
    seen = ball.vertices[ball.vertices[:, 2] > 0.03]
    scene = cloud_scene(np.asarray(seen), 7, ScenesConfig())
    outward = (scene.points - [0, 0, 0.05]) / 0.05
    assert ((scene.normals * outward).sum(1) > 0.9).mean() > 0.95
    dataset = SceneDataset(
        [scene], {}, [], hand.palm_reference, MatchingConfig(), CameraConfig(), seeds=64
    )
    batch = collate([dataset[0], dataset[0]])
    assert batch.object_index.shape == (2, 0)
    assert batch.object_index.dtype == torch.int64
    assert not batch.grasp_mask.any()
    small = NetworkConfig(levels=[64, 16, 8], neighbours=[4, 4, 4])
    found = predict(new_network(small, hand), scene.points)
    assert found.position.shape == (64, 3)
    assert np.isfinite(found.position).all()
