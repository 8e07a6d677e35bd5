"""Files at a path or a URL: of a kind that pyarrow knows (s3://, gs://), or that fsspec does."""

from __future__ import annotations

import os
from pathlib import Path

import pyarrow as pa
import pyarrow.fs as pafs

from dmfc.errors import DmfcError, first_line
from dmfc.files.atomic import write_bytes


def located(place: str) -> tuple[pafs.FileSystem, str]:
    """The file system of a path or URL, and the path in it. Raises DmfcError for an unknown one."""
    if "://" not in place:
        return pafs.LocalFileSystem(), os.path.abspath(place)
    try:
        return pafs.FileSystem.from_uri(place)
    except pa.ArrowInvalid:
        pass  # a scheme that pyarrow does not know
    import fsspec

    try:
        system, path = fsspec.core.url_to_fs(place)
    except (ValueError, ImportError) as error:
        raise DmfcError(f"nothing here opens {place}: {first_line(error)}") from error
    return pafs.PyFileSystem(pafs.FSSpecHandler(system)), path


def join(folder: str, name: str) -> str:
    """The path or URL of a file in a folder; a relative name may lead out of a local one."""
    return f"{folder.rstrip('/')}/{name}" if "://" in folder else os.path.join(folder, name)


def read_file(place: str) -> bytes:
    """The content of a file. Raises DmfcError if it cannot be read."""
    try:
        system, path = located(place)
        with system.open_input_stream(path) as stream:
            return stream.readall()
    except OSError as error:
        raise DmfcError(f"{place} cannot be read: {first_line(error)}") from error


def write_file(place: str, content: bytes) -> None:
    """Write a file and the folders above it; here whole or not at all. DmfcError if that fails."""
    system, path = located(place)
    try:
        system.create_dir(os.path.dirname(path), recursive=True)
        if isinstance(system, pafs.LocalFileSystem):
            write_bytes(Path(path), content)
            return
        with system.open_output_stream(path) as stream:
            stream.write(content)
    except OSError as error:
        raise DmfcError(f"{place} cannot be written: {first_line(error)}") from error
