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
from dmfc.scenes.custom import cloud_scene, import_clouds
from dmfc.scenes.publish.published import PublishedSet, packs_of, publish
from dmfc.scenes.scene_set import SceneSet
from dmfc.training.batch import collate
from dmfc.training.data import SceneDataset
from tests.support import clouds


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


def test_clouds_of_others_are_read_as_predict_reads_them(tmp_path):
    """Upper-case PLY and named fields too, in any unit; the shard holds metres."""
    points = clouds.blob() - [0.1, -0.2, 0]
    fields = np.zeros(len(points), dtype=[("rgb", "f4"), ("x", "f4"), ("y", "f4"), ("z", "f4")])
    for k, name in enumerate("xyz"):
        fields[name] = points[:, k] / 0.0254
    np.save(tmp_path / "a.npy", fields)
    text = "".join(f"{x} {y} {z}\n" for x, y, z in points / 0.0254)
    (tmp_path / "b.xyz").write_text(text)
    names = "".join(f"property float {name}\n" for name in "XYZ")
    header = f"ply\nformat ascii 1.0\nelement vertex {len(points)}\n{names}end_header\n"
    (tmp_path / "c.PLY").write_text(header + text)
    paths = [tmp_path / name for name in ("a.npy", "b.xyz", "c.PLY")]
    assert import_clouds(paths, tmp_path / "new" / "s.parquet", ScenesConfig(), "inch") == 3
    found = SceneSet.open([tmp_path / "new" / "s.parquet"])
    for scene in (found[k] for k in range(3)):
        low, high = scene.points.min(0), scene.points.max(0)
        assert np.allclose([low, high], [points.min(0), points.max(0)], atol=2e-3)


def test_points_without_an_answer_are_left_out_of_a_scene_on_request(tmp_path):
    points = clouds.blob() - [0.1, -0.2, 0]
    dirty = np.concatenate([np.zeros((5, 3)), points, np.full((2, 3), np.nan)])
    np.save(tmp_path / "a.npy", dirty)
    out = tmp_path / "s.parquet"
    with pytest.raises(DmfcError, match=r"a\.npy: 2 of 3007 points are NaN.*--drop-invalid"):
        import_clouds([tmp_path / "a.npy"], out, ScenesConfig())
    np.save(tmp_path / "a.npy", dirty[:-2])
    with pytest.raises(DmfcError, match=r"a\.npy: 5 of 3005 points are exactly \(0, 0, 0\)"):
        import_clouds([tmp_path / "a.npy"], out, ScenesConfig())
    assert not out.exists()
    assert import_clouds([tmp_path / "a.npy"], out, ScenesConfig(), drop_invalid=True) == 1


def test_errors_of_custom_clouds(tmp_path):
    np.savetxt(tmp_path / "b.xyz", clouds.blob())
    with pytest.raises(DmfcError, match="unknown unit 'feet'"):
        import_clouds([tmp_path / "b.xyz"], tmp_path / "s", ScenesConfig(), "feet")
    with pytest.raises(DmfcError, match="at least 16"):
        cloud_scene(np.zeros((3, 3)), 0, ScenesConfig())


@pytest.mark.parametrize(
    ("scale", "above", "why"),
    [
        ([1000, 1000, 1000], -1.0, r"mine\.npy: the cloud is 119\.9 m across.*--unit mm"),
        ([5, 1, 1], -1.0, r"mine\.npy: it reaches 0\.\d+ m from the table's centre.*--unit"),
        ([1, 1, -1], -1.0, r"mine\.npy: it reaches 0\.1\d+ m below the table top"),
        ([1, 1, -1], 0.01, r"mine\.npy: the cloud has 0 points \(3000 were left out\)"),
    ],
)
def test_a_cloud_that_is_not_on_the_table_is_refused(tmp_path, scale, above, why):
    """In another unit, or in the frame of a camera that looks down."""
    points, out = clouds.blob(), tmp_path / "scenes.parquet"
    np.save(tmp_path / "mine.npy", points)
    assert import_clouds([tmp_path / "mine.npy"], out, ScenesConfig(points=64)) == 1
    np.save(tmp_path / "mine.npy", points * scale)
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
        [scene], {}, [], hand.palm_reference, MatchingConfig(), CameraConfig(), num_seeds=64
    )
    batch = collate([dataset[0], dataset[0]])
    assert batch.object_index.shape == (2, 0)
    assert batch.object_index.dtype == torch.int64
    assert not batch.grasp_mask.any()
    small = NetworkConfig(levels=[64, 16, 8], neighbours=[4, 4, 4])
    found = predict(new_network(small, hand), scene.points)
    assert found.position.shape == (64, 3)
    assert np.isfinite(found.position).all()
