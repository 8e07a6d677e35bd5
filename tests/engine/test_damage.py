"""Every file of a store cut short, with a flipped bit, or emptied: noticed on use, or made again.

Whatever is damaged, a call that ends well has the right trial rows; one that does not names the
file and the way out, and the way out leads to the right rows.
"""

import logging
import shutil
from pathlib import Path

import pandas as pd
import pytest

from dmfc.engine.ledger import Ledger
from dmfc.engine.provenance import PROVENANCE, read_provenance
from dmfc.engine.record import RECORD
from dmfc.engine.stage import closure
from dmfc.engine.state import SEALED_VERSION, STATE, read_state
from dmfc.engine.store import repair, verify
from dmfc.experiment.evaluation import read_trials
from dmfc.files.sealed import DamagedError, write_sealed
from dmfc.report.collect import read_sweep
from dmfc.report.outputs import OUTPUTS
from dmfc.report.page import MARKER, PAGE, read_marker
from dmfc.sweep.record import SWEEP
from tests.support.alone import driven, made, patch_science, planned, trial_rows

SWEEP_FILE = """
name: tiny
cells:
  pretrained: {model: pretrained}
  all: {model: finetuned, set: {losses.weights.guidance: 2}}
"""
DAMAGES = {
    "cut short": lambda content: content[: len(content) // 2],
    "a flipped bit": lambda content: (
        content[: len(content) // 2]
        + bytes([content[len(content) // 2] ^ 1])
        + content[len(content) // 2 + 1 :]
    ),
    "emptied": lambda content: b"",
}
every_damage = pytest.mark.parametrize("damage", DAMAGES.values(), ids=DAMAGES)


@pytest.fixture(scope="module")
def sweep(tmp_path_factory):
    """The plan, its finished store, and its trial rows."""
    with pytest.MonkeyPatch.context() as patch:
        patch_science(patch)
        folder = tmp_path_factory.mktemp("damage")
        plan, store = planned(folder / "tiny.yaml", SWEEP_FILE), folder / "store"
        assert driven(plan, store).complete
        marker = {"digest": "0", "uri": "sqlite:///x", "experiment_id": "1", "run_id": "2"}
        write_sealed(plan.folder(Ledger(store)) / MARKER, SEALED_VERSION, {**marker, "runs": {}})
        yield plan, store, trial_rows(plan, store)


def spoiled(original, place, file, damage):
    """A copy of the store with one file damaged."""
    shutil.copytree(original, place)
    path = place / file
    whole = path.read_bytes()
    path.write_bytes(damage(whole))
    assert path.read_bytes() != whole
    return place


def one_of_each_kind(store):
    """The files of one stage of each kind, relative to the store."""
    for kind in sorted((store / "stages").iterdir()):
        for path in sorted(sorted(kind.iterdir())[0].rglob("*")):
            if path.is_file():
                yield path.relative_to(store)


def forget_users(plan, ledger, address):
    """Remove all finished stages that were made from that one."""
    made_from = {address}
    for stage in closure(plan.targets):  # inputs come before their users
        if made_from & {parent.address for parent in stage.parents}:
            made_from.add(stage.address)
            ledger.remove(stage.address)


@every_damage
def test_a_damaged_file_of_a_stage_is_noticed_on_use_or_made_again(sweep, tmp_path, damage):
    plan, original, rows = sweep
    files = list(one_of_each_kind(original))
    assert {path.parts[1] for path in files} == {stage.kind for stage in closure(plan.targets)}
    noticed = made_again = 0
    for number, file in enumerate(files):
        store = spoiled(original, tmp_path / str(number), file, damage)
        ledger, address = Ledger(store), "/".join(file.parts[1:3])
        assert [a for a, wrong in verify(ledger, ledger.present()) if wrong] == [address]
        forget_users(plan, ledger, address)
        told = made(plan, store)
        if file.name == RECORD:
            assert not told
            assert ledger.finished(address)
            made_again += 1
        else:
            assert told
            assert all(f"{file}'" in line and "dmfc store repair" in line for line in told)
            assert [one.address for one in repair(ledger, list(ledger.present()))] == [address]
            assert not made(plan, store)
            noticed += 1
        pd.testing.assert_frame_equal(trial_rows(plan, store), rows)
        assert not any(wrong for _, wrong in verify(ledger, ledger.present()))
    assert noticed + made_again == len(files) > 15


@every_damage
def test_what_is_not_used_changes_no_row(sweep, tmp_path, damage):
    """All is finished: only evaluations are read. Either the rows are right, or it is told."""
    plan, original, rows = sweep
    for number, file in enumerate(one_of_each_kind(original)):
        store = spoiled(original, tmp_path / str(number), file, damage)
        if made(plan, store):
            with pytest.raises(DamagedError, match="dmfc store repair"):
                trial_rows(plan, store)
        else:
            pd.testing.assert_frame_equal(trial_rows(plan, store), rows)


@pytest.mark.full
@every_damage
def test_a_damaged_file_of_a_sweep_is_noticed_or_written_again(sweep, tmp_path, damage, caplog):
    plan, original, rows = sweep
    files = sorted(path.name for path in plan.folder(Ledger(original)).iterdir() if path.is_file())
    readers = {
        SWEEP: lambda ledger, folder: read_sweep(ledger, plan.id),
        STATE: lambda ledger, folder: read_state(folder),
        PROVENANCE: lambda ledger, folder: read_provenance(folder),
        MARKER: lambda ledger, folder: read_marker(folder),
        "trials.parquet": lambda ledger, folder: read_trials(f"{folder}:all"),
        OUTPUTS: lambda ledger, folder: read_trials(f"{folder}:all"),
    }
    assert set(readers) < set(files)
    for number, name in enumerate(files):
        file = Path("sweeps") / plan.id / name
        store = spoiled(original, tmp_path / str(number), file, damage)
        ledger, folder = Ledger(store), store / file.parent
        caplog.clear()
        if name in readers:
            try:
                with caplog.at_level(logging.WARNING):
                    readers[name](ledger, folder)
            except DamagedError as error:
                told = str(error)
                assert "again" in told
            else:
                told = caplog.text
                assert "written again" in told
            assert f"{file}'" in told
        assert driven(plan, store).complete
        pd.testing.assert_frame_equal(trial_rows(plan, store), rows)
        if name.startswith("table.") or name in ("curves.png", "trials.parquet"):
            again = (folder / name).read_bytes()
            assert (again == (original / file).read_bytes()) or name == PAGE
        if name in readers:
            readers[name](ledger, folder)


def test_a_damaged_failure_is_noticed(tmp_path):
    """An object that cannot be repaired: the reason is an output as any other."""
    with pytest.MonkeyPatch.context() as patch:
        patch_science(patch)
        text = f"{SWEEP_FILE}base: {{objects.train: [broken/a, ycb/b]}}\n"
        plan = planned(tmp_path / "tiny.yaml", text)
        assert not made(plan, tmp_path / "store")
        rows = trial_rows(plan, tmp_path / "store")
        (failure, *_) = sorted((tmp_path / "store").glob("stages/object/*/failure.json"))
        file = failure.relative_to(tmp_path / "store")
        for name, damage in DAMAGES.items():
            store = spoiled(tmp_path / "store", tmp_path / name, file, damage)
            ledger = Ledger(store)
            for kind in ("scenes", "pretrain", "finetune", "evaluate"):
                for address in list(ledger.addresses(kind)):
                    ledger.remove(address)
            told = made(plan, store)
            assert told
            assert all(f"{file}'" in line and "dmfc store repair" in line for line in told)
            list(repair(ledger, list(ledger.present())))
            assert not made(plan, store)
            pd.testing.assert_frame_equal(trial_rows(plan, store), rows)
