"""The record of a finished stage's folder: settings, failure, and whether all files are whole.

`stage.json` is sealed and holds the digests of the other files. A folder whose record is damaged is
not finished. One whose other files are damaged is, but `verified` lets nobody use it.
"""

from __future__ import annotations

import json
import logging
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from dmfc.engine.stage import key_of
from dmfc.errors import DmfcError
from dmfc.files.digest import damage
from dmfc.files.sealed import DamagedError, read_sealed

RECORD, FAILURE = "stage.json", "failure.json"
RECORD_VERSION = 3
"""1 had no `files`, the digests; 2 had no digest of itself."""
REMEDY = (
    "`dmfc store repair` sets damaged stages aside, and says which line makes them again "
    "(--store as before)"
)
COPY_REMEDY = "copy the folder again from where it was made, or give another one"

_LOG = logging.getLogger(__name__)
_READABLE: dict[str, tuple[int, int, int]] = {}
_VERIFIED: dict[str, tuple[int, int, int]] = {}
_WARNED: set[str] = set()


def read_record(folder: Path) -> dict[str, Any]:
    """What the `stage.json` in a finished stage's folder says. Raises DamagedError, DmfcError."""
    found = read_sealed(folder / RECORD, RECORD_VERSION)
    if not isinstance(found, dict):
        raise DamagedError(f"'{folder / RECORD}' is damaged: it is no record of a stage")
    return found


def is_finished(folder: Path) -> bool:
    """Whether the folder has a whole record. A damaged one is warned of, once per process.

    Raises DmfcError where the record is there but cannot be opened.
    """
    try:
        mark = _mark(folder)
    except (FileNotFoundError, NotADirectoryError):
        return False
    if _READABLE.get(str(folder)) == mark:
        return True
    try:
        read_record(folder)
    except DamagedError as error:
        if str(folder) not in _WARNED:
            _LOG.warning("%s; the stage counts as not finished and is made again", error)
        _WARNED.add(str(folder))
        return False
    _READABLE[str(folder)] = mark
    return True


def failure_in(folder: Path) -> str | None:
    """The reason in a finished stage's folder; None if it has outputs.

    Raises DamagedError where the reason cannot be read.
    """
    path = folder / FAILURE
    if not path.is_file():
        return None
    try:
        return str(json.loads(path.read_bytes())["reason"])
    except (ValueError, KeyError, TypeError) as error:
        raise DamagedError(f"'{path}' is damaged; {_remedy(folder)}") from error


def identity_key(record: Mapping[str, Any]) -> str:
    """The key that a record's kind, code version, settings and inputs hash to.

    Raises DamagedError where it does not have them.
    """
    try:
        return key_of(record["kind"], record["stage_version"], record["config"], record["inputs"])
    except (KeyError, TypeError, ValueError) as error:
        raise DamagedError(f"the record of a stage is not whole: {error}") from error


def faults(folder: Path) -> list[tuple[str, str]]:
    """Files of a finished stage that are not what they were, each with how: 'has changed'.

    In a store the record must be of that key, too. Empty for a stage that was made before digests
    were kept. Raises DamagedError on its record, OSError where a file cannot be opened.
    """
    record = read_record(folder)
    if "files" not in record:
        return []
    found = list(damage(folder, record["files"], omit=RECORD))
    if _in_store(folder) and identity_key(record) != folder.name:
        found.insert(0, (RECORD, "is of another key"))
    return found


def verified(folder: Path) -> Path:
    """The folder, once its files have been compared with their digests: once per process.

    Folders without a record are taken as they are. Raises DamagedError naming the first file that
    is not what was written, and what to do.
    """
    try:
        mark = _mark(folder)
    except (FileNotFoundError, NotADirectoryError):
        return folder
    if _VERIFIED.get(str(folder)) == mark:
        return folder
    try:
        wrong = faults(folder)
    except DamagedError as error:
        raise DamagedError(f"{error}; {_remedy(folder)}") from error
    except OSError as error:
        raise DmfcError(f"'{folder}' cannot be read: {error.strerror or error}") from error
    if wrong:
        name, how = wrong[0]
        more = f" (and {len(wrong) - 1} more)" if len(wrong) > 1 else ""
        raise DamagedError(f"'{folder / name}' {how}{more}; {_remedy(folder)}")
    _VERIFIED[str(folder)] = mark
    return folder


def _mark(folder: Path) -> tuple[int, int, int]:
    """Tells a record from one that was written later. Raises OSError where there is none."""
    found = (folder / RECORD).stat()
    return found.st_ino, found.st_mtime_ns, found.st_size


def _in_store(folder: Path) -> bool:
    return len(folder.parts) > 2 and folder.parts[-3] == "stages"


def _remedy(folder: Path) -> str:
    return REMEDY if _in_store(folder) else COPY_REMEDY
