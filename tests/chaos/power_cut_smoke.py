"""The smoke sweep on a disk whose power is cut: python -m tests.chaos.power_cut_smoke CALM [COUNT]

CALM is the store of an undisturbed `dmfc sweep table2 --preset smoke`. Copies COUNT (15) images of
a loop-mounted disk while the same sweep runs on it, resumes each, and compares the trial rows.
Needs root and loop devices; half an hour on two cores, so it is called by hand.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import pandas as pd

from tests.support.disk import LoopDisk

ROOT = Path(__file__).resolve().parents[2]
CALL = [sys.executable, "-c", "from dmfc.cli.main import main; main()", "sweep", "table2"]
OPTIONS = ["--preset", "smoke", "--set", "run.tracking_seconds=2", "--json"]


def sweep(store: Path) -> subprocess.Popen:
    """The sweep as a process; what it says to people goes to a file beside the disk."""
    with store.parent.with_name(f"{store.parent.name}.log").open("w") as log:
        environment = {**os.environ, "PYTHONPATH": str(ROOT)}
        return subprocess.Popen(
            [*CALL, *OPTIONS, "--store", str(store)],
            stdout=subprocess.DEVNULL,
            stderr=log,
            env=environment,
        )


def resume(store: Path) -> int:
    """Status of the sweep, called again while a busy machine does not let Ray start: its advice."""
    for _ in range(5):
        status = sweep(store).wait()
        said = store.parent.with_name(f"{store.parent.name}.log").read_text()
        if status == 0 or "Ray did not start on this machine" not in said:
            return status
    return status


def rows(store: Path) -> pd.DataFrame:
    """Trial rows of the one sweep in a store, without times."""
    (path,) = store.glob("sweeps/*/trials.parquet")
    found = pd.read_parquet(path).drop(columns="seconds", errors="ignore")
    return found.sort_values(["cell", "seed", "scene", "trial"]).reset_index(drop=True)


def empty_records(store: Path) -> int:
    """Finished stages whose record has no content."""
    return sum(path.stat().st_size == 0 for path in store.glob("stages/*/*/stage.json"))


def main(calm: Path, count: int = 15) -> int:
    """Prints a line per image; the number of images that did not resume to the same rows."""
    expected, wrong = rows(calm), 0
    with tempfile.TemporaryDirectory() as temporary:
        place = Path(temporary)
        images: list[LoopDisk] = []
        with LoopDisk.make(place / "disk.img", place / "disk", 128) as disk:
            driver, began = sweep(disk.folder / "store"), time.monotonic()
            while driver.poll() is None:
                number = len(images)
                cut = disk.power_cut(place / f"{number}.img", place / f"cut-{number}")
                images.append(cut)
                time.sleep(max(1.0, (time.monotonic() - began) / 40))
            print(f"undisturbed on the disk: status {driver.returncode}, {len(images)} images")
            pd.testing.assert_frame_equal(rows(disk.folder / "store"), expected)
        step = len(images) / count
        for number in sorted({int(step * place) for place in range(count)}):
            with images[number] as disk:
                store = disk.folder / "store"
                before = len(list(store.glob("stages/*/*/stage.json")))
                empty = empty_records(store)
                status = resume(store)
                same = status == 0 and rows(store).equals(expected)
                wrong += not same
                print(
                    f"image {number}: {before} stages, {empty} empty records, status {status}, "
                    f"same rows: {same}",
                    flush=True,
                )
    return wrong


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]), *map(int, sys.argv[2:3])))
