"""Shards: written whole, read back, the same bytes for the same seed, clear errors."""

from __future__ import annotations

import dataclasses
import pickle

import numpy as np
import pyarrow.parquet as pq
import pytest

from dmfc.errors import DmfcError
from dmfc.scenes import scene_set
from dmfc.scenes.layout import choose_objects
from dmfc.scenes.make import make_scene_file
from dmfc.scenes.scene_set import Scene, SceneSet, write_shard


def test_scenes_are_read_back(shards, scenes):
    read = SceneSet.open(shards)
    assert len(read) == len(scenes) == 7
    for number in (0, 2, 3, 6, -1):
        assert_same(read[number], scenes[number])
    assert [scene.scene for scene in read] == list(range(7))
    assert [scene.scene for scene in read[4:6]] == [4, 5]
    with pytest.raises(IndexError):
        read[7]


def assert_same(read: Scene, made: Scene) -> None:
    """Equal but for the quantum of the points (0.02 mm at most) and of the normals."""
    for entry in dataclasses.fields(Scene):
        ours, theirs = getattr(made, entry.name), getattr(read, entry.name)
        if entry.name == "points":
            assert np.abs(ours - theirs).max() < 2e-5
            assert theirs.dtype == np.float32
        elif entry.name == "normals":
            assert np.abs(ours - theirs).max() < 2e-5
        elif isinstance(ours, np.ndarray):
            assert ours.dtype == theirs.dtype
            assert (ours == theirs).all()
        else:
            assert ours == theirs


def test_same_seed_same_bytes_and_shards_do_not_matter(
    tmp_path, shards, config, objects, grasps, hand
):
    again, more = tmp_path / "again.parquet", tmp_path / "more.parquet"
    make_scene_file(config, config.train, range(3, 6), objects, grasps, hand, again)
    assert again.read_bytes() == shards[1].read_bytes()
    larger = dataclasses.replace(config.train, count=1000)
    make_scene_file(config, larger, range(3, 6), objects, grasps, hand, more)
    assert more.read_bytes() == again.read_bytes()
    assert not list(tmp_path.glob("*.partial"))


def test_manifest_says_what_was_made(shards, objects):
    manifest = SceneSet.open(shards).manifests[2]
    assert manifest["numbers"] == [6, 7]
    assert manifest["set"]["kind"] == "multi"
    assert manifest["scenes"]["points"] == 2048
    assert manifest["renderer"] == "embree"
    assert set(manifest["objects"]) <= set(objects)


def test_only_objects_of_the_shard_are_looked_up(tmp_path, config, objects):
    names = choose_objects(config.train, list(objects), 6)

    class Lazy(dict):
        def __getitem__(self, name):
            assert name in names
            return objects[name]

    lazy, out = Lazy.fromkeys(objects), tmp_path / "x.parquet"
    counts = make_scene_file(config, config.train, range(6, 7), lazy, None, None, out)
    assert counts["scenes"] == 1
    assert counts["grasps"] == 0
    assert len(SceneSet.open([out])[0].grasp_index) == 0


def test_progress_is_told(tmp_path, config, objects):
    told: list[tuple[float, str]] = []
    out = tmp_path / "x.parquet"
    make_scene_file(
        config, config.train, range(3), objects, None, None, out, lambda f, m: told.append((f, m))
    )
    assert [f for f, _ in told] == pytest.approx([1 / 3, 2 / 3, 1])
    assert told[0][1] == "scene 0"


def test_a_set_can_be_sent_to_another_process(shards, scenes):
    read = SceneSet.open(shards)
    assert_same(read[5], scenes[5])
    assert_same(pickle.loads(pickle.dumps(read))[5], scenes[5])


def test_a_process_keeps_no_more_than_the_limit(shards, scenes, monkeypatch):
    """With room for two shards of three, whatever the order; what was let go is read again."""
    read = SceneSet.open(shards)
    list(read)
    sizes = [shard.kept_bytes for shard in read._shards]
    assert min(sizes) > 0  # the usual limit keeps all
    monkeypatch.setattr(scene_set, "KEPT_BYTES", sizes[0] + sizes[1])
    for number in (0, 6, 3, 1, 5, 2, 4, 0):
        assert_same(read[number], scenes[number])
        assert sum(shard.kept_bytes for shard in read._shards) <= sizes[0] + sizes[1]
    assert [shard.kept_bytes > 0 for shard in read._shards] == [True, True, False]


def test_url_of_a_shard(shards, scenes):
    assert_same(SceneSet.open([shards[0].as_uri()])[1], scenes[1])


@pytest.mark.parametrize("size", [0, 3, 200, 5000])
def test_truncated_shard_is_named(tmp_path, shards, size):
    damaged = tmp_path / "damaged.parquet"
    damaged.write_bytes(shards[0].read_bytes()[:size])
    with pytest.raises(DmfcError, match=r"damaged\.parquet is damaged or cut short") as caught:
        SceneSet.open([shards[1], damaged])
    assert "\n" not in str(caught.value)


def test_damage_in_the_middle_is_named(tmp_path, shards):
    damaged = tmp_path / "damaged.parquet"
    content = bytearray(shards[0].read_bytes())
    content[1000:40_000] = bytes(39_000)
    damaged.write_bytes(content)
    with pytest.raises(DmfcError, match=r"damaged\.parquet is damaged or cut short"):
        SceneSet.open([damaged])[0]


def test_errors(tmp_path, shards, config, objects, grasps, scenes):
    with pytest.raises(DmfcError, match="at least one shard"):
        SceneSet.open([])
    with pytest.raises(DmfcError, match=r"none\.parquet does not exist"):
        SceneSet.open([tmp_path / "none.parquet"])
    other = tmp_path / "other.parquet"
    pq.write_table(pq.read_table(shards[0]).replace_schema_metadata({}), other)
    with pytest.raises(DmfcError, match="format version none, expected 2"):
        SceneSet.open([other])
    with pytest.raises(DmfcError, match="need the hand"):
        make_scene_file(config, config.train, range(3), objects, grasps, None, other)
    with pytest.raises(DmfcError, match="cannot be written"):
        write_shard(tmp_path / "no" / "folder.parquet", scenes[:1], {})
