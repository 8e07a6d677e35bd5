"""Keys and the ledger: what a stage depends on, and that it is never half there."""

import dataclasses
import hashlib
import json
from pathlib import Path

import pytest

from dmfc.config.load import build_config
from dmfc.config.plain_yaml import parse_yaml
from dmfc.config.schema import Config
from dmfc.config.setting import KEYS_VERSION, setting
from dmfc.engine.ledger import Ledger
from dmfc.engine.record import RECORD, RECORD_VERSION
from dmfc.engine.stage import Stage, closure, differences, plain
from dmfc.errors import DmfcError
from tests.support.trivial_graph import trivial


@dataclasses.dataclass(frozen=True)
class Settings:
    rate: float = setting(1.0, "")
    threads: int = setting(1, "", resource=True)
    polish: int = setting(0, "", later=KEYS_VERSION)


def key(**config):
    return Stage("kind", "name", 1, config).key


def test_the_key_depends_on_exactly_what_it_should():
    base = Stage("kind", "name", 1, {"a": Settings()})
    assert base.key == Stage("kind", "other name", 1, {"a": Settings()}).key
    assert base.key == Stage("kind", "name", 1, {"a": Settings(threads=8)}).key
    assert base.key != Stage("kind", "name", 2, {"a": Settings()}).key
    assert base.key != Stage("other", "name", 1, {"a": Settings()}).key
    assert base.key != Stage("kind", "name", 1, {"a": Settings(rate=2.0)}).key
    one, two = trivial("add", "x", 1), trivial("add", "x", 2)
    keys = {trivial("add", "y", 1, {"in": given}).key for given in (one, two, (one,), (one, two))}
    assert len(keys) == 4


def test_a_later_setting_enters_a_key_where_it_is_not_at_its_default():
    @dataclasses.dataclass(frozen=True)
    class Before:
        rate: float = setting(1.0, "")

    assert key(a=Settings(polish=0)) == key(a=Before())
    assert len({key(a=Settings(polish=n)) for n in range(3)}) == 3
    assert plain(Settings(polish=2)) == {"rate": 1.0, "polish": 2}


def test_a_renamed_setting_enters_a_key_under_its_former_name():
    @dataclasses.dataclass(frozen=True)
    class Renamed:
        speed: float = setting(1.0, "", formerly="rate")

    @dataclasses.dataclass(frozen=True)
    class Before:
        rate: float = setting(1.0, "")

    assert key(a=Renamed()) == key(a=Before())
    assert key(a=Renamed(speed=2.0)) == key(a=Before(rate=2.0))


def test_the_next_version_of_keys_ends_a_later_setting(monkeypatch):
    monkeypatch.setattr("dmfc.config.setting.KEYS_VERSION", KEYS_VERSION + 1)
    assert plain(Settings()) == {"rate": 1.0, "polish": 0}


def test_a_store_with_keys_of_another_version_is_refused_on_one_line(tmp_path):
    new = Ledger(tmp_path / "new")
    new.prepare()
    new.check_version()
    (new.store / "version.json").write_text('{"keys": 1}')
    with pytest.raises(DmfcError, match=r"keys 1, this one has 2.*give another --store") as caught:
        new.prepare()
    assert "\n" not in str(caught.value)
    old = Ledger(tmp_path / "old")  # before stores had a version
    (old.folder("hand/a")).mkdir(parents=True)
    (old.folder("hand/a") / "stage.json").write_text("{}")
    with pytest.raises(DmfcError, match="made by another version"):
        old.check_version()


def test_the_order_of_keys_does_not_matter():
    assert key(a=1, b={"c": 2, "d": 3}) == key(b={"d": 3, "c": 2}, a=1)


def test_comments_and_order_in_yaml_rerun_nothing():
    one = "training:\n  seed: 3\n  batch_size: 2\nmatching: {mode: literal}\n"
    two = "# a remark\nmatching:\n  mode: literal # literal\ntraining: {batch_size: 2, seed: 3}\n"
    configs = [build_config([("here", parse_yaml(text, "here"))]) for text in (one, two)]
    assert key(c=configs[0]) == key(c=configs[1])
    assert key(c=configs[0]) != key(c=Config())


def test_a_key_is_the_hash_of_its_canonical_text():
    """Fails when the scheme of keys changes, which would orphan every store there is."""
    hand = Stage("hand", "hand", 3, {"name": "shadow"})
    stage = Stage("object", "mug", 1, {"s": Settings(), "id": "ycb/mug"}, {"hand": hand})
    hand_text = '{"config":{"name":"shadow"},"inputs":{},"keys":2,"kind":"hand","version":3}'
    hand_key = hashlib.sha256(hand_text.encode()).hexdigest()[:32]
    text = (
        '{"config":{"id":"ycb/mug","s":{"rate":1.0}},"inputs":{"hand":"hand/'
        + hand_key
        + '"},"keys":2,"kind":"object","version":1}'
    )
    assert stage.key == hashlib.sha256(text.encode()).hexdigest()[:32]


def test_nothing_without_a_stable_text_enters_a_key():
    with pytest.raises(TypeError, match="cannot be part"):
        plain({"a": object()})
    with pytest.raises(ValueError, match="Out of range"):
        _ = Stage("kind", "name", 1, {"a": float("nan")}).key


def test_differences_name_the_setting():
    old, new = plain(Config()), plain(build_config([("", {"losses.weights.collision": 2})]))
    assert list(differences(old, new)) == ["losses.weights.collision 1.0 -> 2.0"]


def test_closure_lists_inputs_first_and_once():
    a = trivial("add", "a")
    b, c = trivial("add", "b", 2, {"i": a}), trivial("add", "c", 3, {"i": a})
    names = [stage.name for stage in closure([trivial("add", "d", 4, {"i": (b, c)}), b])]
    assert sorted(names) == ["a", "b", "c", "d"]
    assert names[0] == "a"
    assert names[-1] == "d"


def test_a_stage_is_there_only_when_its_record_is(ledger):
    ledger.prepare()
    with ledger.claim("add/k") as out:
        (out / "file").write_text("half")
        assert not ledger.finished("add/k")
        assert list(ledger.records("add")) == []
    assert not out.exists()
    with ledger.claim("add/k") as out:
        assert list(out.iterdir()) == []
        (out / "file").write_text("whole")
        ledger.commit("add/k", {"name": "k"})
    assert ledger.finished("add/k")
    assert (ledger.folder("add/k") / "file").read_text() == "whole"
    assert [record["name"] for record in ledger.records("add")] == ["k"]
    with ledger.claim("add/k") as out:
        assert out is None


def test_an_exception_leaves_nothing_behind(ledger):
    def attempt():
        with ledger.claim("add/k") as out:
            (out / "file").write_text("half")
            raise ValueError

    with pytest.raises(ValueError):  # noqa: PT011
        attempt()
    assert not ledger.folder("add/k").exists()
    assert [path.name for path in (ledger.store / "stages" / "add").iterdir()] == []


def test_what_a_killed_process_left_is_cleared(ledger):
    left = ledger.store / "stages" / "add" / ".partial-k"
    left.mkdir(parents=True)
    (left / "file").write_text("half")
    with ledger.claim("add/k") as out:
        assert list(out.iterdir()) == []


def test_a_damaged_record_is_one_line_and_no_stage(ledger, caplog):
    ledger.folder("add/k").mkdir(parents=True)
    (ledger.folder("add/k") / RECORD).write_text("{")
    with pytest.raises(DmfcError, match=r"stage\.json' is damaged"):
        ledger.record("add/k")
    assert not ledger.finished("add/k")
    assert not ledger.finished("add/k")
    assert list(ledger.addresses()) == list(ledger.records("add")) == []
    assert list(ledger.present()) == ["add/k"]
    assert caplog.text.count("is made again") == 1
    with ledger.claim("add/k") as out:
        (out / "file").write_text("again")
        ledger.commit("add/k", {"name": "k"})
    assert (ledger.folder("add/k") / "file").read_text() == "again"
    (aside,) = (ledger.store / "damaged").iterdir()
    assert (aside / RECORD).read_text() == "{"


def test_a_store_that_cannot_be_written_is_one_line(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(DmfcError, match="cannot write to the store"):
        Ledger(tmp_path / "file" / "store").prepare()


@pytest.mark.parametrize("url", ["s3://bucket/store", "gs://bucket/store", "hdfs://host/store"])
def test_a_store_at_a_url_is_refused_on_one_line(url):
    for given in (url, Path(url)):
        with pytest.raises(DmfcError, match=r"cannot be.*--store") as caught:
            Ledger(given)
        assert "\n" not in str(caught.value)


def test_a_store_at_a_file_url_is_its_folder(tmp_path):
    for given in (f"file://{tmp_path}/s", Path(f"file://{tmp_path}/s"), tmp_path / "s"):
        assert Ledger(given).store == tmp_path / "s"


def test_records_are_plain_json(ledger):
    with ledger.claim("add/k"):
        ledger.commit("add/k", {"name": "k"})
    assert json.loads((ledger.folder("add/k") / RECORD).read_text())["version"] == RECORD_VERSION
