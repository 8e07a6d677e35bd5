"""Packs: pip's own client against a local folder of hand-made distributions; unpacking; errors."""

from __future__ import annotations

import hashlib
import io
import tarfile
import zipfile
from pathlib import Path

import pytest

from dmfc import assets
from dmfc.assets import cache, packs
from dmfc.assets.packs import Pack
from dmfc.assets.unpack import unpack
from dmfc.errors import DmfcError, MachineError

MEMBERS = {
    "pretend/models/one.txt": b"one",
    "pretend/models/deep/two.txt": b"two",
    "pretend/code.py": b"raise SystemExit",
}


def pack_of(archive: Path, **changes) -> Pack:
    fields = {
        "name": "pretend",
        "requirement": "dmfc-pretend-pack==1.0",
        "sha256": hashlib.sha256(archive.read_bytes()).hexdigest(),
        "subfolder": "pretend/models",
        "licence": "none",
        "contents": "for tests",
        "download_mb": 0,
        "pip_options": ("--only-binary=:all:", "--no-index", f"--find-links={archive.parent}"),
    }
    return Pack(**{**fields, **changes})


def wheel(folder: Path) -> Path:
    path = folder / "dmfc_pretend_pack-1.0-py3-none-any.whl"
    info = "dmfc_pretend_pack-1.0.dist-info"
    with zipfile.ZipFile(path, "w") as bundle:
        for name, content in MEMBERS.items():
            bundle.writestr(name, content)
        bundle.writestr(
            f"{info}/METADATA", "Metadata-Version: 2.1\nName: dmfc-pretend-pack\nVersion: 1.0\n"
        )
        bundle.writestr(
            f"{info}/WHEEL", "Wheel-Version: 1.0\nRoot-Is-Purelib: true\nTag: py3-none-any\n"
        )
        bundle.writestr(f"{info}/RECORD", "")
    return path


@pytest.fixture
def pretend(tmp_path, monkeypatch) -> Pack:
    """A pack that pip finds in a folder, with an empty cache."""
    source = tmp_path / "index"
    source.mkdir()
    pack = pack_of(wheel(source))
    monkeypatch.setattr(packs, "PACKS", (pack,))
    monkeypatch.setenv("DMFC_CACHE", str(tmp_path / "cache"))
    cache._verified.cache_clear()
    return pack


def test_pull_verify_and_offline(pretend, monkeypatch):
    assert assets.status("pretend") == "missing"
    folder = assets.pull("pretend")
    files = sorted(p.relative_to(folder).as_posix() for p in folder.rglob("*") if p.is_file())
    assert files == ["deep/two.txt", "one.txt"]
    assert (folder / "one.txt").read_bytes() == b"one"
    assert assets.verify("pretend") == 2
    assert assets.status("pretend") == "cached"

    def no_download(*_):
        raise AssertionError("a cached pack must not be downloaded")

    monkeypatch.setattr(cache, "download", no_download)
    assert assets.pull("pretend") == folder
    assert not [p for p in folder.parent.parent.iterdir() if p.name.startswith(".pretend")]


def test_a_shared_pack_needs_neither_cache_nor_network(pretend, tmp_path, monkeypatch):
    store = tmp_path / "store"
    assets.share("pretend", store)
    assets.share("pretend", store)  # it is there
    monkeypatch.setenv("DMFC_CACHE", str(tmp_path / "elsewhere"))
    monkeypatch.setenv("PIP_NO_INDEX", "1")
    pack = pack_of_like(pretend, pip_options=("--no-index",))
    monkeypatch.setattr(packs, "PACKS", (pack,))
    with assets.also_in(store):
        folder = assets.pull("pretend")
    assert folder.is_relative_to(store)
    assert (folder / "one.txt").read_bytes() == b"one"
    assert not (tmp_path / "elsewhere").exists()
    with pytest.raises(MachineError, match="was not downloaded"):
        assets.pull("pretend")


def test_a_shared_pack_that_is_damaged_is_an_error_of_the_machine(pretend, tmp_path, monkeypatch):
    assets.share("pretend", tmp_path / "store")
    (damaged,) = (tmp_path / "store").glob("packs/*/files/one.txt")
    damaged.write_bytes(b"two")
    monkeypatch.setenv("DMFC_CACHE", str(tmp_path / "elsewhere"))
    cache._verified.cache_clear()
    with (
        assets.also_in(tmp_path / "store"),
        pytest.raises(MachineError, match=r"corrupt: 'one.txt' has changed"),
    ):
        assets.pull("pretend")


@pytest.mark.parametrize("damage", ["change", "delete", "manifest"])
def test_corrupt_pack(pretend, damage):
    folder = assets.pull("pretend")
    if damage == "change":
        (folder / "one.txt").write_bytes(b"two")
    elif damage == "delete":
        (folder / "one.txt").unlink()
    else:
        (folder.parent / "manifest.json").write_text("{")
    for call in (assets.verify, assets.pull):
        cache._verified.cache_clear()
        with pytest.raises(
            DmfcError, match=r"corrupt.*delete .* and run 'dmfc assets pull"
        ) as info:
            call("pretend")
        assert "\n" not in str(info.value)


def test_wrong_hash_and_unreachable(pretend, monkeypatch):
    for pack, message in (
        (pack_of_like(pretend, sha256="0" * 64), "another SHA-256"),
        (pack_of_like(pretend, requirement="dmfc-pretend-pack==2.0"), "does not offer"),
        (
            pack_of_like(
                pretend,
                pip_options=("--index-url=http://127.0.0.1:9/simple", "--retries=1"),
                requirement="dmfc-pretend-elsewhere==1.0",
            ),
            "cannot be reached",
        ),
    ):
        monkeypatch.setenv("PIP_CONFIG_FILE", "/dev/null")
        monkeypatch.delenv("PIP_FIND_LINKS", raising=False)
        monkeypatch.setattr(packs, "PACKS", (pack,))
        with pytest.raises(DmfcError, match=message) as info:
            assets.pull("pretend")
        assert "\n" not in str(info.value)


def pack_of_like(pack: Pack, **changes) -> Pack:
    return Pack(**{**pack.__dict__, **changes})


def test_unknown_pack_names_the_nearest():
    with pytest.raises(DmfcError, match="did you mean 'shadow_hand'"):
        assets.pull("shadow_hnad")


def test_verify_of_a_pack_that_was_not_pulled(pretend):
    with pytest.raises(DmfcError, match="not in the cache"):
        assets.verify("pretend")


def tar_of(folder: Path, members: list[tarfile.TarInfo], content: bytes = b"x") -> Path:
    path = folder / "pretend-1.0.tar.gz"
    with tarfile.open(path, "w:gz") as bundle:
        for member in members:
            member.size = len(content) if member.isreg() else 0
            bundle.addfile(member, io.BytesIO(content))
    return path


def test_unpack_refuses_unsafe_members(tmp_path):
    link = tarfile.TarInfo("pretend/models/link")
    link.type, link.linkname = tarfile.SYMTYPE, "/etc/passwd"
    for number, member in enumerate(
        [
            tarfile.TarInfo("pretend/models/../../up.txt"),
            tarfile.TarInfo("pretend/models//abs"),
            link,
        ]
    ):
        archive = tar_of(tmp_path, [member])
        with pytest.raises(DmfcError, match="unsafe member"):
            unpack(archive, pack_of(archive), tmp_path / f"out{number}")
    assert not (tmp_path / "up.txt").exists()


def test_unpack_limits_and_filters(tmp_path):
    names = ["pretend/models/a.stl", "pretend/models/b.txt", "other/c.stl"]
    archive = tar_of(tmp_path, [tarfile.TarInfo(name) for name in names])
    assert unpack(archive, pack_of(archive, suffixes=(".stl",)), tmp_path / "out") == ["a.stl"]
    with pytest.raises(DmfcError, match="more than 1 bytes"):
        unpack(archive, pack_of(archive), tmp_path / "small", max_bytes=1)
    with pytest.raises(DmfcError, match="nothing under"):
        unpack(archive, pack_of(archive, subfolder="none"), tmp_path / "none")
    archive.write_bytes(b"not an archive")
    with pytest.raises(DmfcError, match="was not unpacked"):
        unpack(archive, pack_of(archive), tmp_path / "broken")


def test_registry_is_pinned():
    for pack in assets.list_packs():
        assert "==" in pack.requirement
        assert len(pack.sha256) == 64
        assert pack.licence


def test_shadow_hand_pack(shadow_hand_dir):
    assert (shadow_hand_dir / "right_hand.xml").is_file()
    assert assets.verify("shadow_hand") > 10
