"""Tables, rows and pictures that people and scripts read later: their digests lie beside them."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from dmfc.files.digest import file_digest
from dmfc.files.sealed import DamagedError, read_or_replace, read_sealed, write_sealed

OUTPUTS = "outputs.json"
VERSION = 1


def note_outputs(folder: Path, names: Iterable[str]) -> None:
    """Keep the digests of files that were just written into `folder`."""
    known = read_or_replace(folder / OUTPUTS, VERSION) or {"files": {}}
    files = known["files"] | {name: file_digest(folder / name) for name in names}
    write_sealed(folder / OUTPUTS, VERSION, {"files": files})


def intact(folder: Path, name: str) -> bool:
    """Whether `name` was noted, and all that was noted in `folder` is as it was."""
    known = read_or_replace(folder / OUTPUTS, VERSION) or {"files": {}}
    return name in known["files"] and all(
        (folder / file).is_file() and file_digest(folder / file) == digest
        for file, digest in known["files"].items()
    )


def whole_output(path: Path, remedy: str) -> Path:
    """The path, unless digests lie beside it and the file is not what was written.

    Raises DamagedError with the `remedy`.
    """
    if not (path.parent / OUTPUTS).is_file():
        return path
    try:
        recorded = read_sealed(path.parent / OUTPUTS, VERSION)["files"].get(path.name)
    except DamagedError as error:
        raise DamagedError(f"{error}; {remedy}") from error
    if recorded is not None and recorded != file_digest(path):
        raise DamagedError(f"'{path}' has changed since it was written; {remedy}")
    return path
