"""Unpacks an archive of stages without trust: only the files and bytes that its manifest lists."""

from __future__ import annotations

import gzip
import json
import shutil
import tarfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any, BinaryIO, cast

from dmfc.errors import DmfcError

MANIFEST = "manifest.json"
MANIFEST_BYTES = 2**28
"""A longer manifest is refused: some two million files."""
OLD_BYTES = 2**36
"""Most that an archive may hold whose manifest does not say how much."""
TAR_BYTES = 4096
"""Most that the tar format takes for a file beside its content."""


def unpacked(archive: Path, folder: Path) -> Mapping[str, Any]:
    """Unpack an archive into `folder`; its manifest.

    Raises DmfcError where it has no manifest, holds a file that this does not list or more bytes
    than it says, or the disk has no room; tarfile's and zlib's errors where it is damaged.
    """
    with archive.open("rb") as opened:
        zipped = opened.read(2) == b"\x1f\x8b"
        opened.seek(0)
        plain = cast(BinaryIO, gzip.GzipFile(fileobj=opened)) if zipped else opened
        bounded = _Bounded(plain, archive, MANIFEST_BYTES)
        with tarfile.open(fileobj=cast(Any, bounded), mode="r|") as tar:
            manifest = _manifest(tar, archive)
            names = _names(manifest, archive)
            limit = _limit(manifest, archive)
            free = shutil.disk_usage(folder).free
            if limit > free and "bytes" in manifest:
                raise DmfcError(
                    f"'{archive}' holds {limit / 1e9:.1f} GB, and there is room for "
                    f"{free / 1e9:.1f} GB at {folder.parent} (--store)"
                )
            bounded.left = min(limit, free) + TAR_BYTES * (len(names) + 16)
            while (member := tar.next()) is not None:
                if not member.isreg() or member.name not in names:
                    raise DmfcError(f"'{archive}' was not taken in: unexpected '{member.name}'")
                names.remove(member.name)
                tar.extract(member, folder, filter="data")
    return manifest


class _Bounded:
    """A stream of which at most `left` bytes can be read: what is packed may be much smaller."""

    def __init__(self, stream: BinaryIO, archive: Path, left: int) -> None:
        self._stream, self._archive, self.left = stream, archive, left

    def read(self, size: int) -> bytes:
        found = self._stream.read(size)
        self.left -= len(found)
        if self.left < 0:
            raise DmfcError(f"'{self._archive}' was not taken in: it holds more than it says")
        return found


def _manifest(tar: tarfile.TarFile, archive: Path) -> dict[str, Any]:
    first = tar.next()
    try:
        stream = tar.extractfile(first) if first is not None and first.isreg() else None
        if first is None or stream is None or first.name != MANIFEST:
            raise ValueError(f"it does not begin with {MANIFEST}")
        found = json.loads(stream.read())
        return {**found, "stages": list(found["stages"]), "folders": dict(found["folders"])}
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        raise DmfcError(
            f"'{archive}' is not an archive of stages: no manifest ({error})"
        ) from error


def _names(manifest: Mapping[str, Any], archive: Path) -> set[str]:
    try:
        return {
            f"{folder}/{name}" for folder, files in manifest["folders"].items() for name in files
        }
    except TypeError as error:
        raise DmfcError(
            f"'{archive}' is not an archive of stages: no manifest ({error})"
        ) from error


def _limit(manifest: Mapping[str, Any], archive: Path) -> int:
    stated = manifest.get("bytes", OLD_BYTES)
    if not isinstance(stated, int) or stated < 0:
        raise DmfcError(f"'{archive}': its manifest says {stated!r} bytes")
    return stated
