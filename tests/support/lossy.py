"""A power cut without a disk: what was not synced is lost, at every moment when a file is renamed.

Of a file that was written and not synced since, the name survives and the content does not: what
file systems that write names first leave. Needs no rights, and knows this process alone.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest


class LossyDisk:
    """Copies of `folder` as a power cut would leave it, one after every rename that ends."""

    def __init__(self, folder: Path, copies: Path) -> None:
        self.folder, self.copies = folder, copies
        self.images: list[Path] = []
        self._synced: set[tuple[int, int, int]] = set()

    @contextmanager
    def watching(self) -> Iterator[None]:
        """Watch what this process syncs and renames."""
        fsync, replace, rename = os.fsync, os.replace, os.rename

        def watched_fsync(descriptor: int) -> None:
            fsync(descriptor)
            self._synced.add(_mark(os.fstat(descriptor)))

        def watched(move):
            def renamed(source, target, **options) -> None:
                move(source, target, **options)
                self.cut()

            return renamed

        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(os, "fsync", watched_fsync)
            patch.setattr(os, "replace", watched(replace))
            patch.setattr(os, "rename", watched(rename))
            yield

    def cut(self) -> None:
        """Copy the folder; what is not synced is empty there."""
        image = self.copies / f"{len(self.images):03d}"
        for path in sorted(self.folder.rglob("*")):
            target = image / path.relative_to(self.folder)
            if path.is_dir():
                target.mkdir(parents=True, exist_ok=True)
                continue
            target.parent.mkdir(parents=True, exist_ok=True)
            if _mark(path.stat()) in self._synced:
                shutil.copy2(path, target)
            else:
                target.touch()
        self.images.append(image)


def _mark(found: os.stat_result) -> tuple[int, int, int]:
    return found.st_ino, found.st_mtime_ns, found.st_size
