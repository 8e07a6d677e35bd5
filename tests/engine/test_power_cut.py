"""The power goes at any moment: what is left goes on to the rows of an undisturbed run."""

import json

import pandas as pd
import pytest

from dmfc.engine.context import read_attempt, read_progress
from dmfc.engine.ledger import Ledger
from dmfc.engine.record import RECORD
from dmfc.engine.state import read_state, write_state
from dmfc.engine.store import verify
from dmfc.engine.system import SAMPLES, sampled
from tests.support.alone import made, patch_science, planned, trial_rows
from tests.support.lossy import LossyDisk

SWEEP_FILE = """
name: tiny
cells:
  all: {model: finetuned}
"""


def test_whenever_the_power_goes_the_sweep_goes_on(tmp_path):
    with pytest.MonkeyPatch.context() as patch:
        patch_science(patch)
        plan = planned(tmp_path / "tiny.yaml", SWEEP_FILE)
        disk = LossyDisk(tmp_path / "store", tmp_path / "cuts")
        with disk.watching():
            folder = plan.write(Ledger(disk.folder))
            write_state(folder, "RUNNING", {})
            assert not made(plan, disk.folder)
            write_state(folder, "FINISHED", {})
        rows = trial_rows(plan, disk.folder)
        stages = len(list(Ledger(disk.folder).addresses()))
        assert len(disk.images) > 3 * stages
        # One in thirteen, at all phases of a commit, and the last one.
        for image in [*disk.images[::13], disk.images[-1]]:
            ledger = Ledger(image)
            records = list(image.glob(f"stages/*/[!.]*/{RECORD}"))
            assert all(json.loads(path.read_bytes()) for path in records)
            assert not any(wrong for _, wrong in verify(ledger, ledger.present()))
            read_state(plan.folder(ledger))
            assert not made(plan, image)
            pd.testing.assert_frame_equal(trial_rows(plan, image), rows)
            assert len(list(ledger.addresses())) == stages


def test_the_disk_of_these_tests_loses_what_is_not_synced(tmp_path):
    """A commit as it was before: the record of a finished stage is empty after the cut."""
    disk = LossyDisk(tmp_path / "store", tmp_path / "cuts")
    partial = disk.folder / "stages" / "add" / ".partial-k"
    partial.mkdir(parents=True)
    with disk.watching():
        (partial / RECORD).write_text("{}")
        partial.rename(partial.with_name("k"))
    assert (disk.images[-1] / "stages" / "add" / "k" / RECORD).read_bytes() == b""


@pytest.mark.parametrize(
    "left", [b"", b"\x00\x00\x00", b'{"attempt": "a", "ho', b"[]", b'{"a": 1}']
)
def test_what_a_process_told_before_is_done_without(tmp_path, left):
    """Progress and attempts are written often and not synced: a power cut may leave anything."""
    (tmp_path / "progress.json").write_bytes(left)
    (tmp_path / "attempt.json").write_bytes(left)
    assert read_progress(tmp_path) == (0.0, "")
    assert read_attempt(tmp_path) == {}


def test_samples_go_on_after_torn_lines(tmp_path):
    path = tmp_path / SAMPLES
    path.write_bytes(b'{"time": 1}\n\x00\x00\x00\n{"time": 2}\n{"ti')
    with sampled(tmp_path, 0.01, 0.0):
        while b"cpu_utilization" not in path.read_bytes():
            pass
    times = [json.loads(line)["time"] for line in path.read_text().splitlines()]
    assert times[:2] == [1, 2]
    assert len(times) > 2
