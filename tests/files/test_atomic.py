"""Files that are whole or not there, on the disk before their names; JSON that knows its digest."""

import json
import os

import pytest

from dmfc.errors import DmfcError
from dmfc.files.atomic import move, write_json, write_text, written_whole
from dmfc.files.digest import damage, folder_digests
from dmfc.files.sealed import DamagedError, read_or_replace, read_sealed, write_sealed

VALUE = {"name": "mug", "numbers": [1, 2.5, None], "inner": {"é": True}}


def half_written(path):
    with written_whole(path) as temporary:
        temporary.write_text("half")
        raise KeyboardInterrupt


def test_what_is_interrupted_leaves_the_old_file(tmp_path):
    path = tmp_path / "file"
    write_text(path, "old")
    with pytest.raises(KeyboardInterrupt):
        half_written(path)
    assert path.read_text() == "old"
    assert os.listdir(tmp_path) == ["file"]


@pytest.fixture
def calls(monkeypatch):
    """What is synced and renamed, in order, as names."""
    told = []
    fsync, replace = os.fsync, os.replace

    def record_fsync(descriptor):
        told.append(("sync", os.path.basename(os.readlink(f"/proc/self/fd/{descriptor}"))))
        fsync(descriptor)

    def record_replace(source, target, **options):
        told.append(("rename", os.path.basename(target)))
        replace(source, target, **options)

    monkeypatch.setattr(os, "fsync", record_fsync)
    monkeypatch.setattr(os, "replace", record_replace)
    return told


def test_content_is_on_the_disk_before_the_name_and_the_name_before_we_go_on(tmp_path, calls):
    write_json(tmp_path / "file", VALUE)
    (first, temporary), *rest = calls
    assert (first, temporary[:6]) == ("sync", ".file.")
    assert rest == [("rename", "file"), ("sync", tmp_path.name)]


def test_a_folder_is_on_the_disk_with_all_that_is_in_it(tmp_path, calls):
    source, target = tmp_path / "a", tmp_path / "there" / "b"
    (source / "inner").mkdir(parents=True)
    target.parent.mkdir()
    for name in ("one", "inner/two"):
        (source / name).write_text(name)
    move(source, target)
    renamed = calls.index(("rename", "b"))
    assert {name for _, name in calls[:renamed]} == {"one", "two", "inner", "a"}
    assert calls.index(("sync", "two")) < calls.index(("sync", "inner")) < renamed
    assert calls[renamed + 1 :] == [("sync", "there"), ("sync", tmp_path.name)]
    assert (target / "inner/two").read_text() == "inner/two"


def test_what_is_told_often_is_not_synced(tmp_path, calls):
    write_json(tmp_path / "file", VALUE, durable=False)
    assert calls == [("rename", "file")]
    assert json.loads((tmp_path / "file").read_text()) == VALUE


def test_every_flipped_bit_of_a_sealed_file_is_seen(tmp_path):
    """Or means the same: a space more, another case of a digit."""
    path = tmp_path / "plan.json"
    write_sealed(path, 2, VALUE)
    whole = path.read_bytes()
    assert read_sealed(path, 2) == {**VALUE, "version": 2}
    told = []
    for place in range(len(whole)):
        for bit in range(8):
            changed = bytearray(whole)
            changed[place] ^= 1 << bit
            path.write_bytes(changed)
            try:
                assert read_sealed(path, 2) == {**VALUE, "version": 2}
            except DamagedError as error:
                told.append(str(error))
    assert len(told) > 0.95 * 8 * len(whole)
    assert all(line.startswith(f"'{path}' is damaged") and "\n" not in line for line in told)


def test_every_truncation_of_a_sealed_file_is_seen(tmp_path):
    path = tmp_path / "plan.json"
    write_sealed(path, 2, VALUE)
    whole = path.read_bytes()
    for length in range(len(whole) - 1):  # the last byte is the end of the line
        path.write_bytes(whole[:length])
        with pytest.raises(DamagedError):
            read_sealed(path, 2)


def test_files_of_before_have_no_digest(tmp_path):
    path = tmp_path / "old.json"
    for old in ([1, 2], {"a": 1}, {"a": 1, "version": 1}):
        write_json(path, old)
        assert read_sealed(path, 2) == old
    write_json(path, {"a": 1, "version": 2})
    with pytest.raises(DamagedError, match="has no digest"):
        read_sealed(path, 2)
    with pytest.raises(DmfcError, match="cannot be read"):
        read_sealed(tmp_path / "missing", 2)


def test_a_damaged_file_is_set_aside_with_a_warning(tmp_path, caplog):
    path = tmp_path / "state.json"
    assert read_or_replace(path, 2) is None
    assert not caplog.text
    path.write_bytes(b"")
    assert read_or_replace(path, 2) is None
    assert f"'{path}' is damaged: it is empty; it is set aside" in caplog.text
    assert os.listdir(tmp_path) == ["state.json.damaged"]


def test_a_folder_is_compared_with_its_digests(tmp_path):
    (tmp_path / "inner").mkdir()
    for name in ("a", "b", "inner/c", "record"):
        (tmp_path / name).write_text(name)
    recorded = folder_digests(tmp_path, omit="record")
    assert sorted(recorded) == ["a", "b", "inner/c"]
    assert list(damage(tmp_path, recorded, omit="record")) == []
    (tmp_path / "a").write_text("A")
    (tmp_path / "b").unlink()
    (tmp_path / "inner/d").touch()
    assert list(damage(tmp_path, recorded, omit="record")) == [
        ("a", "has changed"),
        ("b", "is missing"),
        ("inner/d", "does not belong there"),
    ]
