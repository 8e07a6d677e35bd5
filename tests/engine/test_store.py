"""What a store holds: checked, pruned, and moved to another machine as one archive."""

import io
import json
import tarfile

import pytest

from dmfc.engine.archive import export, export_to, fetched, take_in
from dmfc.engine.engine import run_stages
from dmfc.engine.ledger import Ledger
from dmfc.engine.stage import closure
from dmfc.engine.store import entries, find, prunable, prune, referred, verify
from dmfc.errors import DmfcError
from dmfc.pipeline.graph import GraphBuilder
from dmfc.sweep.planner import plan_sweep
from dmfc.sweep.sweep_file import load_sweep
from tests.support.fake_science import FAKES, fake_refs
from tests.support.trivial_graph import TRIVIAL, trivial


@pytest.fixture
def swept(ledger, tmp_path):
    """A finished sweep, and one stage that belongs to none."""
    path = tmp_path / "tiny.yaml"
    path.write_text("cells: {a: {model: finetuned}}\n")
    plan = plan_sweep(load_sweep(str(path)), GraphBuilder(fake_refs, FAKES), "smoke")
    plan.write(ledger)
    run_stages(plan.targets, ledger, plan.config, kinds=FAKES, local=True)
    run_stages([trivial("add", "alone")], ledger, plan.config, kinds=TRIVIAL, local=True)
    return plan


def test_every_stage_is_listed_and_found(swept, ledger):
    found = {entry.address: entry for entry in entries(ledger)}
    assert set(found) == {s.address for s in closure(swept.targets)} | {trivial("add", "x").address}
    model = swept.cells[0].stages.model.address
    assert found[model].name == "a seed 0"
    assert found[model].bytes > 100
    assert find(ledger, model) == find(ledger, model.partition("/")[2][:12]) == model
    with pytest.raises(DmfcError, match="begins"):
        find(ledger, "evaluate/")
    with pytest.raises(DmfcError, match="unknown stage"):
        find(ledger, "nothing")


def test_damage_is_seen(swept, ledger):
    assert not any(wrong for _, wrong in verify(ledger, ledger.addresses()))
    pretrain, finetune = (next(ledger.addresses(kind)) for kind in ("pretrain", "finetune"))
    (ledger.folder(pretrain) / "weights").write_text("bit rot")
    (ledger.folder(pretrain) / "extra").touch()
    record = ledger.folder(finetune) / "stage.json"
    record.write_text(record.read_text().replace('"q1_upper": 0.0', '"q1_upper": 0.5'))
    told = dict(verify(ledger, [pretrain, finetune]))
    assert told[pretrain] == ["extra does not belong there", "weights has changed"]
    assert told[finetune] == ["its record is of another key"]
    with pytest.raises(DmfcError, match="cannot be exported"):
        export(ledger, [pretrain], [], ledger.store / "x.tar")


def test_pruning_removes_what_no_sweep_needs(swept, ledger):
    doomed = prunable(ledger, swept.record().targets)
    assert [entry.name for entry in doomed] == ["alone"]
    assert prunable(ledger, swept.record().targets, older_than_days=1) == []
    left = ledger.store / "stages" / "add" / ".partial-k"
    left.mkdir()
    with ledger.lock(doomed[0].address):
        assert prune(Ledger(ledger.store), doomed) == []
    assert prune(ledger, doomed) == doomed
    assert not left.exists()
    assert referred(ledger, swept.record().targets) == set(ledger.addresses())
    assert len(prunable(ledger, [])) == len(closure(swept.targets))


@pytest.mark.parametrize("name", ["a.tar", "a.tar.gz"])
def test_an_archive_carries_a_sweep_to_another_store(swept, ledger, tmp_path, name):
    archive, other = tmp_path / name, Ledger(tmp_path / "other")
    addresses = referred(ledger, swept.record().targets)
    assert export(ledger, addresses, [swept.id], archive) == len(addresses)
    brought = take_in(other, archive)
    assert set(brought.stages) == set(other.addresses()) == addresses
    assert brought.sweeps == [swept.id]
    assert not any(wrong for _, wrong in verify(other, other.addresses()))
    outcomes = run_stages(swept.targets, other, swept.config, kinds=FAKES, local=True)
    assert {outcome.status for outcome in outcomes.values()} == {"done"}
    again = take_in(other, archive)
    assert (again.stages, set(again.known)) == ([], addresses)
    assert [path.name for path in (other.store / "work").iterdir()] == []
    with pytest.raises(DmfcError, match="is there already"):
        export(ledger, addresses, [], archive)


@pytest.mark.parametrize("scheme", ["file", "memory"])
def test_an_archive_may_lie_at_a_url(swept, ledger, tmp_path, scheme):
    place, other = f"{scheme}://{tmp_path}/a.tar.gz", Ledger(tmp_path / "other")
    addresses = referred(ledger, swept.record().targets)
    assert export_to(ledger, addresses, [swept.id], place) == len(addresses)
    with fetched(other, place) as local:
        assert set(take_in(other, local).stages) == addresses
    assert list((other.store / "work").iterdir()) == []
    with pytest.raises(DmfcError, match="is there already"):
        export_to(ledger, addresses, [], place)
    missing = place.replace("a.tar", "b.tar")
    with pytest.raises(DmfcError, match="was not copied"), fetched(other, missing):
        pass
    with pytest.raises(DmfcError, match="nothing here opens"):
        export_to(ledger, addresses, [], "nowhere://a.tar")


def rewrite(archive, changes):
    """The archive with the content of some members replaced, or members added."""
    with tarfile.open(archive) as tar:
        members = {m.name: tar.extractfile(m).read() for m in tar if m.isfile()}
    with tarfile.open(archive, "w") as tar:
        for name, content in {**members, **changes}.items():
            head = tarfile.TarInfo(name)
            head.size = len(content)
            tar.addfile(head, io.BytesIO(content))


def test_a_damaged_or_hostile_archive_adds_nothing(swept, ledger, tmp_path):
    whole, other = tmp_path / "whole.tar", Ledger(tmp_path / "other")
    address = trivial("add", "x").address
    export(ledger, [address], [], whole)
    record = json.loads((ledger.folder(address) / "stage.json").read_text())
    manifest = {"version": 1, "stages": [], "folders": {"stages/../../x": {}}}
    other_stage = {"version": 1, "stages": ["../x/y"], "folders": {}}
    for changes, part in [
        ({f"stages/{address}/sum.json": b"7"}, "sum.json has changed"),
        ({f"stages/{address}/extra": b""}, "does not belong there"),
        ({f"stages/{address}/stage.json": json.dumps(record).encode()}, "has changed"),
        ({"manifest.json": b"{}"}, "no manifest"),
        ({"manifest.json": json.dumps(manifest).encode()}, "unexpected folder"),
        ({"manifest.json": json.dumps(other_stage).encode()}, "lists other stages"),
        ({"../../evil": b"x"}, "was not taken in"),
    ]:
        archive = tmp_path / "bad.tar"
        archive.write_bytes(whole.read_bytes())
        rewrite(archive, changes)
        with pytest.raises(DmfcError, match=part):
            take_in(other, archive)
    archive.write_bytes(whole.read_bytes()[:700])
    with pytest.raises(DmfcError):
        take_in(other, archive)
    archive.write_text("no archive")
    with pytest.raises(DmfcError, match="is no tar archive"):
        take_in(other, archive)
    assert list(other.addresses()) == []
    assert not (tmp_path / "evil").exists()


@pytest.mark.parametrize("name", ["a.tar", "a.tar.gz"])
def test_no_flipped_byte_is_taken_in(swept, ledger, tmp_path, name):
    """Wherever it is: refused on one line, or in a place that holds nothing (padding, times)."""
    archive = tmp_path / name
    export(ledger, [trivial("add", "x").address], [], archive)
    whole = archive.read_bytes()
    for place in range(0, len(whole), max(1, len(whole) // 60)):
        archive.write_bytes(whole[:place] + bytes([whole[place] ^ 0x5A]) + whole[place + 1 :])
        other = Ledger(tmp_path / f"other-{place}")
        try:
            take_in(other, archive)
        except DmfcError:
            assert list(other.addresses()) == []
        assert not any(wrong for _, wrong in verify(other, other.addresses()))


def test_a_forged_record_is_refused(ledger, tmp_path):
    """Digests that fit a record of other settings: the key does not."""
    with ledger.claim("add/k"):
        ledger.commit("add/k", {"kind": "add", "stage_version": 1, "config": {}, "inputs": {}})
    archive = tmp_path / "forged.tar"
    with pytest.raises(DmfcError, match="another key"):
        export(ledger, ["add/k"], [], archive)
