"""The library: planned grasp sets that come with the package, so that nobody has to plan first.

One file per object, `<hand>/<source>__<name>.parquet`, made by `dmfc grasps plan ... --out FOLDER`.
"""

from __future__ import annotations

from importlib import resources
from pathlib import Path

from dmfc.errors import DmfcError


def library_folder(chosen: str = "") -> Path:
    """The folder `chosen` (setting grasps.library), or where that is empty the package's.

    Raises DmfcError where there is no such folder.
    """
    if not chosen:
        return Path(str(resources.files("dmfc.grasps") / "data"))
    folder = Path(chosen).expanduser().absolute()
    if not folder.is_dir():
        raise DmfcError(f"grasps.library: {folder} is not a folder")
    return folder


def file_name(hand: str, object_id: str) -> str:
    """Path of an object's grasp set in a library; a hand that is a YAML file goes by its name."""
    return f"{Path(hand).name}/{object_id.replace('/', '__')}.parquet"


def in_library(hand: str, object_id: str, folder: Path) -> bool:
    """Whether the library in `folder` has grasps of an object."""
    return (folder / file_name(hand, object_id)).is_file()


def library_file(hand: str, object_id: str, folder: Path | None = None) -> Path:
    """The file of an object's grasps in `folder` (None: the package's). DmfcError without one."""
    folder = folder or library_folder()
    if not in_library(hand, object_id, folder):
        raise DmfcError(
            f"the library has no grasps of '{object_id}' for the hand '{hand}': "
            "set grasps.source=either to plan what it lacks"
        )
    return folder / file_name(hand, object_id)
