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


def library_file(hand: str, object_id: str) -> Path:
    """The file of an object's grasps. Raises DmfcError if the library has none."""
    path = library_folder() / file_name(hand, object_id)
    if not path.is_file():
        raise DmfcError(
            f"the library has no grasps of '{object_id}' for the hand '{hand}': "
            "set grasps.source=plan to plan them"
        )
    return path


def file_digest(path: Path) -> str:
    """SHA-256 of a file."""
    return hashlib.sha256(path.read_bytes()).hexdigest()
