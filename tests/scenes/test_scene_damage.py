"""A full disk, a killed process, a truncated shard: each costs one shard, and is mended."""

from __future__ import annotations

import dataclasses
import os
import subprocess
import sys
from pathlib import Path

import pytest

from dmfc.config.load import load_config
from dmfc.engine.engine import run_stages
from dmfc.engine.ledger import Ledger
from dmfc.engine.store import repair
from dmfc.errors import DmfcError
from dmfc.pipeline.graph import GraphBuilder
from dmfc.scenes.scene_set import SceneSet, write_shard
from tests.support.shape_stages import TROUBLED, shape_refs
from tests.support.small_files import small_files

ROOT = Path(__file__).resolve().parents[2]
CONFIG = load_config("smoke", ["scenes.train.kind=multi", "scenes.train.count=9"])
CONFIG = dataclasses.replace(CONFIG, scenes=dataclasses.replace(CONFIG.scenes, shard_size=3))


def shards():
    return GraphBuilder(shape_refs, TROUBLED).scenes(CONFIG, "train")


def make(store):
    """Status of each shard after one call in this process, with its reason."""
    made = run_stages(shards(), Ledger(store), CONFIG, kinds=TROUBLED, local=True)
    return [(made[shard.address].status, made[shard.address].reason) for shard in shards()]


def content(store):
    folders = [Ledger(store).folder(shard.address) for shard in shards()]
    return [(folder / "scenes.parquet").read_bytes() for folder in folders]


@pytest.fixture(scope="module")
def calm(tmp_path_factory):
    """The bytes of all shards where nothing went wrong."""
    store = tmp_path_factory.mktemp("calm")
    assert [status for status, _ in make(store)] == ["ran"] * 3
    return content(store)


def test_a_full_disk_costs_the_shard_that_it_met(tmp_path, monkeypatch, calm):
    monkeypatch.setenv("TROUBLE", "1:full disk")
    (first, _), (second, why), (third, _) = make(tmp_path)
    assert (first, second, third) == ("ran", "failed", "ran")
    assert "File too large" in why
    monkeypatch.delenv("TROUBLE")
    assert [status for status, _ in make(tmp_path)] == ["done", "ran", "done"]
    assert content(tmp_path) == calm


def test_a_killed_process_costs_the_shard_in_work(tmp_path, calm):
    code = (
        "import sys; from pathlib import Path; from tests.scenes.test_scene_damage import make\n"
        "make(Path(sys.argv[1]))"
    )
    sign = tmp_path / "sign"
    settings = {"PYTHONPATH": str(ROOT), "TROUBLE": "1:killed", "TROUBLE_SIGN": str(sign)}
    store = tmp_path / "store"
    killed = subprocess.run(
        [sys.executable, "-c", code, store], env={**os.environ, **settings}, check=False
    )
    assert killed.returncode == -9
    assert sign.exists()
    ledger = Ledger(store)
    assert [ledger.finished(shard.address) for shard in shards()] == [True, False, False]
    assert [status for status, _ in make(store)] == ["done", "ran", "ran"]
    assert content(store) == calm
    assert not list(store.rglob("*.partial"))


def test_a_truncated_shard_is_told_and_made_again(tmp_path, calm):
    make(tmp_path)
    ledger = Ledger(tmp_path)
    names = [shard.address for shard in shards()]
    assert list(repair(ledger, names)) == []
    path = ledger.folder(names[2]) / "scenes.parquet"
    path.write_bytes(path.read_bytes()[:-1000])
    with pytest.raises(DmfcError, match="`dmfc scenes make` makes it again"):
        SceneSet.open([path])
    (found,) = repair(ledger, names)
    assert (found.address, found.wrong) == (names[2], ["scenes.parquet has changed"])
    assert found.aside
    assert [status for status, _ in make(tmp_path)] == ["done", "done", "ran"]
    assert content(tmp_path) == calm


def test_a_full_disk_leaves_the_old_file(tmp_path, scenes):
    path = tmp_path / "shard.parquet"
    write_shard(path, scenes[:1], {})
    before = path.read_bytes()
    told = r"shard\.parquet cannot be written: .*File too large"
    with small_files(len(before) // 2), pytest.raises(DmfcError, match=told):
        write_shard(path, scenes, {})
    assert path.read_bytes() == before
    assert [entry.name for entry in tmp_path.iterdir()] == ["shard.parquet"]
