"""What a store holds: checked, pruned, and moved to another machine as one archive."""

import hashlib
import io
import json
import tarfile
from pathlib import Path

import pytest

from dmfc.engine.archive import export, export_to, fetched, take_in
from dmfc.engine.engine import run_stages
from dmfc.engine.ledger import Ledger
from dmfc.engine.record import RECORD
from dmfc.engine.stage import closure
from dmfc.engine.store import entries, find, prunable, prune, referred, repair, verify
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
    assert "stage.json' is damaged: its content does not fit" in told[finetune][0]
    with pytest.raises(DmfcError, match="cannot be exported"):
        export(ledger, [pretrain], [], ledger.store / "x.tar")


def test_verify_goes_on_past_what_cannot_be_read(swept, ledger):
    addresses = sorted(ledger.addresses())
    (ledger.folder(addresses[0]) / RECORD).write_bytes(b"")
    (ledger.folder(addresses[2]) / RECORD).unlink()
    (ledger.folder(addresses[4]) / "extra").touch()
    found = dict(verify(ledger, ledger.present()))
    assert list(found) == addresses
    assert {a for a, wrong in found.items() if wrong} == {addresses[k] for k in (0, 2, 4)}


def test_a_stage_under_another_name_is_seen(ledger):
    """Digests that fit, and the record of other settings: the key does not."""
    forged(ledger, "add/k")
    assert dict(verify(ledger, ["add/k"]))["add/k"] == ["stage.json is of another key"]
    with pytest.raises(DmfcError, match=r"stage\.json' is of another key; `dmfc store repair`"):
        ledger.verified("add/k")


def test_repair_sets_damaged_stages_aside(swept, ledger):
    evaluation = swept.targets[0].address
    weights, record = next(ledger.addresses("pretrain")), next(ledger.addresses("hand"))
    (ledger.folder(weights) / "weights").write_text("bit rot")
    (ledger.folder(record) / RECORD).write_bytes(b"")
    (ledger.folder(evaluation) / "trials.parquet").unlink()
    before = set(ledger.present())
    with ledger.lock(evaluation):
        found = list(repair(Ledger(ledger.store), list(ledger.present())))
    assert {one.address: one.aside is not None for one in found} == {
        weights: True,
        record: True,
        evaluation: False,
    }
    assert set(ledger.present()) == before - {weights, record}
    aside = next(one.aside for one in found if one.address == weights)
    assert (Path(aside) / "weights").read_text() == "bit rot"
    assert [one.address for one in repair(ledger, list(ledger.present()))] == [evaluation]
    outcomes = run_stages(swept.targets, ledger, swept.config, kinds=FAKES, local=True)
    ran = {address for address, outcome in outcomes.items() if outcome.status == "ran"}
    assert evaluation in ran  # its inputs are needed once more, what made the others is not
    assert weights not in ran
    assert not any(wrong for _, wrong in verify(ledger, ledger.present()))


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
    with pytest.raises(DmfcError, match="exists already"):
        export(ledger, addresses, [], archive)


@pytest.mark.parametrize("scheme", ["file", "memory"])
def test_an_archive_may_lie_at_a_url(swept, ledger, tmp_path, scheme):
    place, other = f"{scheme}://{tmp_path}/a.tar.gz", Ledger(tmp_path / "other")
    addresses = referred(ledger, swept.record().targets)
    assert export_to(ledger, addresses, [swept.id], place) == len(addresses)
    with fetched(other, place) as local:
        assert set(take_in(other, local).stages) == addresses
    assert list((other.store / "work").iterdir()) == []
    with pytest.raises(DmfcError, match="exists already"):
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
    negative, huge = ({**other_stage, "bytes": number} for number in (-1, 10**18))
    for changes, part in [
        ({f"stages/{address}/sum.json": b"7"}, "sum.json has changed"),
        ({f"stages/{address}/extra": b""}, "unexpected 'stages/.*/extra'"),
        ({f"stages/{address}/stage.json": json.dumps(record).encode()}, "has changed"),
        ({"manifest.json": b"{}"}, "no manifest"),
        ({"manifest.json": b"[1]"}, "no manifest"),
        ({"manifest.json": b'{"stages": [], "folders": {"a": 3}}'}, "no manifest"),
        ({"manifest.json": json.dumps(manifest).encode()}, "unexpected 'stages/add"),
        ({"manifest.json": json.dumps(other_stage).encode()}, "unexpected 'stages/add"),
        ({"manifest.json": json.dumps(negative).encode()}, "says -1 bytes"),
        ({"manifest.json": json.dumps(huge).encode()}, "there is room for"),
        ({"../../evil": b"x"}, "unexpected '../../evil'"),
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
    with pytest.raises(DmfcError, match="is not a tar archive"):
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


def forged(ledger, address):
    """A stage whose key is not that of its settings."""
    with ledger.claim(address):
        ledger.commit(address, {"kind": "add", "stage_version": 1, "config": {}, "inputs": {}})


def packed(archive, source, folders, **changes):
    """An archive as somebody else may make it: manifest and files agree, and nothing else may."""
    files = {
        f"{folder}/{path.name}": path.read_bytes()
        for folder in folders
        for path in (source / folder).iterdir()
        if path.is_file()
    }
    digests = {folder: {} for folder in folders}
    for name, content in files.items():
        folder, _, file = name.rpartition("/")
        digests[folder][file] = hashlib.sha256(content).hexdigest()
    stages = [folder.removeprefix("stages/") for folder in folders if folder[:7] == "stages/"]
    size = sum(len(content) for content in files.values())
    manifest = {"version": 1, "stages": stages, "folders": digests, "bytes": size, **changes}
    members = {"manifest.json": json.dumps(manifest).encode(), **files}
    with tarfile.open(archive, "w:gz") as tar:
        for name, content in members.items():
            head = tarfile.TarInfo(name)
            head.size = len(content)
            tar.addfile(head, io.BytesIO(content))


def test_what_its_own_digests_do_not_fit_is_refused(swept, ledger, tmp_path):
    """Manifest and files agree: the digests inside the stages are compared too."""
    archive, other = tmp_path / "x.tar.gz", Ledger(tmp_path / "other")
    whole, broken = sorted(ledger.addresses("pretrain")) + sorted(ledger.addresses("finetune"))
    folders = [f"stages/{address}" for address in (whole, broken)]
    packed(archive, ledger.store, folders)
    assert take_in(Ledger(tmp_path / "good"), archive).stages == [whole, broken]
    forged(ledger, "add/k")
    packed(archive, ledger.store, [*folders, "stages/add/k"])
    with pytest.raises(DmfcError, match=r"in add/k stage\.json is of another key"):
        take_in(other, archive)
    (ledger.folder(broken) / "weights").write_text("bit rot")
    packed(archive, ledger.store, folders)
    with pytest.raises(DmfcError, match=f"in {broken} weights has changed"):
        take_in(other, archive)
    plan = ledger.store / "sweeps" / swept.id / "sweep.json"
    plan.write_bytes(plan.read_bytes().replace(b'"seed": 0', b'"seed": 1', 1))
    packed(archive, ledger.store, [folders[0], f"sweeps/{swept.id}"])
    with pytest.raises(DmfcError, match=r"sweep\.json' is damaged"):
        take_in(other, archive)
    assert list(other.present()) == []
    assert list((other.store / "sweeps").iterdir()) == []


def test_an_archive_cannot_unpack_to_more_than_it_says(ledger, tmp_path):
    """A gigabyte of zeros is a megabyte when packed."""
    source, archive = tmp_path / "source", tmp_path / "bomb.tar.gz"
    (source / "stages/add/k").mkdir(parents=True)
    (source / "stages/add/k/zeros").write_bytes(bytes(2**26))
    packed(archive, source, ["stages/add/k"], bytes=1000)
    assert archive.stat().st_size < 2**18
    with pytest.raises(DmfcError, match="holds more than it says"):
        take_in(ledger, archive)
    assert list((ledger.store / "work").iterdir()) == []


def test_an_import_that_fails_half_way_adds_nothing(swept, ledger, tmp_path, monkeypatch):
    archive, other = tmp_path / "a.tar", Ledger(tmp_path / "other")
    addresses = referred(ledger, swept.record().targets)
    export(ledger, addresses, [swept.id], archive)
    adopted = []

    def adopt(self, address, folder):
        if len(adopted) == 3:
            raise OSError(28, "No space left on device")
        adopted.append(address)
        Ledger_adopt(self, address, folder)

    Ledger_adopt = Ledger.adopt
    monkeypatch.setattr(Ledger, "adopt", adopt)
    with pytest.raises(DmfcError, match="No space left"):
        take_in(other, archive)
    assert list(other.present()) == []
    assert list((other.store / "sweeps").iterdir()) == []
    monkeypatch.undo()
    assert set(take_in(other, archive).stages) == addresses
