"""The library: planned grasp sets that come with the package, so that nobody has to plan first.

One file per object, `<hand>/<source>__<name>.parquet`, made by `dmfc grasps plan ... --out FOLDER`.
"""

from __future__ import annotations

import hashlib
from importlib import resources
from pathlib import Path

from dmfc.errors import DmfcError


def library_folder() -> Path:
    """Where the package keeps its grasp sets."""
    return Path(str(resources.files("dmfc.grasps") / "library"))


def file_name(hand: str, object_id: str) -> str:
    """Path of an object's grasp set within a library."""
    return f"{hand}/{object_id.replace('/', '__')}.parquet"


def in_library(hand: str, object_id: str) -> bool:
    """Whether the library has grasps of an object."""
    return (library_folder() / file_name(hand, object_id)).is_file()


def library_file(hand: str, object_id: str) -> Path:
    """The file of an object's grasps. Raises DmfcError if the library has none."""
    if not in_library(hand, object_id):
        raise DmfcError(
            f"the library has no grasps of '{object_id}' for the hand '{hand}': "
            "set grasps.source=either to plan what it lacks"
        )
    return library_folder() / file_name(hand, object_id)


def file_digest(path: Path) -> str:
    """SHA-256 of a file."""
    return hashlib.sha256(path.read_bytes()).hexdigest()
