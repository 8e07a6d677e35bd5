"""Digests of files: what a finished stage holds, so that a copy or a disk can be checked."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path

from dmfc.files.digest import file_digest

RECORD = "stage.json"


def folder_digests(folder: Path) -> dict[str, str]:
    """Digest of each file under `folder` by its relative POSIX path, but of the stage's record."""
    return {
        path.relative_to(folder).as_posix(): file_digest(path)
        for path in sorted(folder.rglob("*"))
        if path.is_file() and path != folder / RECORD
    }


def damage(folder: Path, recorded: Mapping[str, str]) -> Iterator[str]:
    """What differs between a folder and the digests recorded of it: 'weights changed'."""
    found = folder_digests(folder)
    for name in sorted(recorded.keys() | found.keys()):
        if name not in found:
            yield f"{name} is missing"
        elif name not in recorded:
            yield f"{name} does not belong there"
        elif found[name] != recorded[name]:
            yield f"{name} has changed"
