"""Files that are written whole or not at all: a reader never sees half of one, nor does a reader
after a power cut. A file is on the disk before it takes its name, and its name before we go on.
"""

from __future__ import annotations

import errno
import json
import os
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

_NO_SYNC = (errno.EINVAL, errno.ENOTSUP)
"""What some network file systems answer to the sync of a folder: they have nothing to sync."""


@contextmanager
def written_whole(path: Path, *, durable: bool = True) -> Iterator[Path]:
    """Gives a temporary name beside `path`; what is written there takes the place of `path`.

    Nothing changes where the block raises. Without `durable` the file may be lost or empty after a
    power cut: for what is written often and can be done without.
    """
    temporary = path.with_name(f".{path.name}.{uuid.uuid4().hex[:8]}")
    try:
        yield temporary
        if durable:
            move(temporary, path)
        else:
            temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


def write_bytes(path: Path, content: bytes, *, durable: bool = True) -> None:
    """Write a file whole or not at all."""
    with written_whole(path, durable=durable) as temporary:
        temporary.write_bytes(content)


def write_text(path: Path, text: str, *, durable: bool = True) -> None:
    """Write a text file (UTF-8) whole or not at all."""
    write_bytes(path, text.encode(), durable=durable)


def write_json(path: Path, value: Any, *, durable: bool = True) -> None:
    """Write `value` as JSON, whole or not at all."""
    write_text(path, json.dumps(value, indent=1, sort_keys=True) + "\n", durable=durable)


def move(source: Path, target: Path) -> None:
    """Rename a file or a folder with all that is in it, once it is on the disk.

    Both must be on one file system. A file at `target` is replaced; so is an empty folder.
    """
    sync_tree(source)
    source.replace(target)
    sync(target.parent)
    if source.parent != target.parent:
        sync(source.parent)


def sync_tree(path: Path) -> None:
    """Bring a file, or a folder and everything under it, onto the disk."""
    if path.is_dir() and not path.is_symlink():
        for entry in path.iterdir():
            sync_tree(entry)
    if not path.is_symlink():
        sync(path)


def sync(path: Path) -> None:
    """Bring the content of one file, or the names in one folder, onto the disk."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    except OSError as error:
        if error.errno not in _NO_SYNC:
            raise
    finally:
        os.close(descriptor)
