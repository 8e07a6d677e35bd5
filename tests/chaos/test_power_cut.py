"""The power of a real disk is cut while a sweep runs on it: fifteen images, all of which go on.

The disk is an ext4 image on a loop device, which needs root: elsewhere there is no such test here,
and `tests/engine/test_power_cut.py` does so with copies that lose what is not synced. With the
science of the smoke preset: tests/chaos/power_cut_smoke.py.
"""

import os
import subprocess
import sys
import time
from pathlib import Path

import pandas as pd
import pytest

from dmfc.engine.ledger import Ledger
from dmfc.engine.state import read_state
from dmfc.engine.store import verify
from tests.support.alone import made, patch_science, planned, trial_rows
from tests.support.disk import LoopDisk, loop_disks

pytestmark = pytest.mark.chaos
ROOT = Path(__file__).resolve().parents[2]
IMAGES = 15
PATIENCE = 300.0
SWEEP = """
name: tiny
cells:
  pretrained: {model: pretrained}
  all: {model: finetuned, set: {losses.weights.guidance: 2}}
"""


def cut_at_every_stage(disk: LoopDisk, sweep: Path, folder: Path) -> list[LoopDisk]:
    """Images of the disk, taken after each stage, or while it ends, in turn."""
    gates, images = folder / "gates", []
    gates.mkdir()
    driver = subprocess.Popen(
        [sys.executable, "-m", "tests.chaos.power_cut_driver", disk.folder / "store", sweep, gates],
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        stderr=subprocess.DEVNULL,
    )
    end = time.monotonic() + PATIENCE
    while driver.poll() is None:
        number = len(images)
        (gates / str(number)).touch()
        while number % 2 and driver.poll() is None and not (gates / f"{number}.done").exists():
            assert time.monotonic() < end
            time.sleep(0.01)
        images.append(disk.power_cut(folder / f"{number}.img", folder / f"cut-{number}"))
    assert driver.returncode == 0
    return images


if loop_disks():

    def test_every_image_of_a_cut_disk_goes_on_to_the_same_rows(tmp_path):
        with pytest.MonkeyPatch.context() as patch:
            patch_science(patch)
            plan = planned(tmp_path / "tiny.yaml", SWEEP)
            assert not made(plan, tmp_path / "calm")
            rows = trial_rows(plan, tmp_path / "calm")
            stages = set(Ledger(tmp_path / "calm").addresses())
            with LoopDisk.make(tmp_path / "disk.img", tmp_path / "disk", 32) as disk:
                images = cut_at_every_stage(disk, tmp_path / "tiny.yaml", tmp_path)
            chosen = images[:: len(images) // IMAGES][:IMAGES]
            assert len(chosen) == IMAGES
            known = []
            for image in chosen:
                with image as disk:
                    ledger = Ledger(disk.folder / "store")
                    known.append(len(list(ledger.addresses())))
                    assert not any(wrong for _, wrong in verify(ledger, ledger.present()))
                    assert read_state(plan.folder(ledger)).status != "RUNNING"
                    assert not made(plan, ledger.store)
                    pd.testing.assert_frame_equal(trial_rows(plan, ledger.store), rows)
                    assert set(ledger.addresses()) == stages
            assert known == sorted(known)
            assert 0 < known[len(known) // 2] < len(stages)
