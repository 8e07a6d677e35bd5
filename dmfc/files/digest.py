"""SHA-256 of files, folders and texts, and differences from stored digests."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any


def file_digest(path: Path) -> str:
    """SHA-256 of a file, as hexadecimal digits."""
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def bytes_digest(content: bytes) -> str:
    """SHA-256 of some bytes, as hexadecimal digits."""
    return hashlib.sha256(content).hexdigest()


def text_digest(text: str) -> str:
    """SHA-256 of a text in UTF-8, as hexadecimal digits."""
    return bytes_digest(text.encode())


def json_digest(value: Any) -> str:
    """SHA-256 of a value of JSON's types, whatever the order of its keys."""
    return text_digest(json.dumps(value, sort_keys=True))


def folder_digests(folder: Path, omit: str = "") -> dict[str, str]:
    """Digest of each file under `folder` by its relative POSIX path, but of the file `omit`."""
    return {
        path.relative_to(folder).as_posix(): file_digest(path)
        for path in sorted(folder.rglob("*"))
        if path.is_file() and path != folder / omit
    }


def damage(folder: Path, recorded: Mapping[str, str], omit: str = "") -> Iterator[tuple[str, str]]:
    """Files that differ from the digests recorded of a folder, each with how: 'has changed'."""
    found = folder_digests(folder, omit)
    for name in sorted(recorded.keys() | found.keys()):
        if name not in found:
            yield name, "is missing"
        elif name not in recorded:
            yield name, "does not belong there"
        elif found[name] != recorded[name]:
            yield name, "has changed"
