"""The files of a folder and of those below it."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path


def files_below(folder: Path, suffixes: Sequence[str]) -> list[Path]:
    """Files with one of the suffixes (lower case) in a folder and below, in order of their paths.

    Links to folders are followed, each folder once. What is hidden is left out: a name that begins
    with a dot, as the `._` files that macOS writes beside those it copies.
    """
    found: list[Path] = []
    seen: set[tuple[int, int]] = set()
    for root, folders, files in os.walk(folder, followlinks=True):
        status = os.stat(root)
        if (status.st_dev, status.st_ino) in seen:
            folders.clear()
            continue
        seen.add((status.st_dev, status.st_ino))
        folders[:] = sorted(name for name in folders if not name.startswith("."))
        found += [
            Path(root, name)
            for name in files
            if not name.startswith(".") and Path(name).suffix.lower() in suffixes
        ]
    return sorted(path for path in found if path.is_file())
