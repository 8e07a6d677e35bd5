"""A file system of its own on a loop device: a copy of its image is what a power cut leaves.

Needs Linux, root, loop devices, mkfs.ext4 and e2fsck. What a program has written and not synced is
in memory alone, and not in the copy.
"""

from __future__ import annotations

import os
import subprocess
import tempfile
import uuid
from functools import cache
from pathlib import Path


@cache
def loop_disks() -> bool:
    """Whether this machine lets us mount images: one is tried."""
    if os.geteuid() != 0 or not Path("/dev/loop-control").exists():
        return False
    with tempfile.TemporaryDirectory() as temporary:
        place = Path(temporary)
        try:
            with LoopDisk.make(place / "disk.img", place / "disk", 1):
                return True
        except (AssertionError, FileNotFoundError):
            return False


class LoopDisk:
    """An ext4 image, mounted at `folder` while the context lasts."""

    def __init__(self, image: Path, folder: Path) -> None:
        self.image, self.folder = image, folder

    @classmethod
    def make(cls, image: Path, folder: Path, megabytes: int) -> LoopDisk:
        """A new and empty one."""
        with image.open("wb") as file:
            file.truncate(megabytes * 2**20)
        _run("mkfs.ext4", "-q", "-F", image)
        return cls(image, folder)

    def __enter__(self) -> LoopDisk:
        self.folder.mkdir(parents=True, exist_ok=True)
        _run("mount", "-o", "loop", self.image, self.folder)
        return self

    def __exit__(self, *_: object) -> None:
        _run("umount", self.folder)

    def power_cut(self, image: Path, folder: Path) -> LoopDisk:
        """What the disk holds now as a disk of its own, to be mounted at `folder`.

        The journal is written first, as it is every five seconds: names reach the disk, and the
        content of files that nobody synced does not.
        """
        probe = self.folder / f".probe-{uuid.uuid4().hex}"
        with probe.open("w") as file:
            os.fsync(file.fileno())
        _run("cp", "--sparse=always", self.image, image)
        probe.unlink()
        subprocess.run(["e2fsck", "-fy", image], capture_output=True, check=False)
        return LoopDisk(image, folder)


def _run(*command: object) -> None:
    done = subprocess.run([*map(str, command)], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
