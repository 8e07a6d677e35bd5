"""The formats by name, and the files of a path."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from dmfc.errors import DmfcError, unknown_name
from dmfc.files.below import files_below
from dmfc.grasps.exchange import dexgraspbench, dexgraspnet, graspit
from dmfc.grasps.exchange.foreign import ForeignGrasps
from dmfc.grasps.exchange.hand_map import HandMap
from dmfc.objects.model import ObjectModel

FORMATS = {
    "graspit": graspit.SUFFIX,
    "dexgraspnet": dexgraspnet.SUFFIX,
    "dexgraspbench": dexgraspbench.SUFFIX,
}
"""Format -> suffix of its files."""


def read_foreign(name: str, paths: Sequence[Path], hand_map: HandMap) -> ForeignGrasps:
    """The grasps in files, or in all files below folders, in order of their names.

    Their frame is that of the format's object. Raises DmfcError for an unknown format, and naming
    the file that is missing or something else.
    """
    files = files_of(name, paths)
    if name == "graspit":
        return graspit.read(files)
    if name == "dexgraspnet":
        return dexgraspnet.read(files, list(hand_map.joints))
    return dexgraspbench.read(files)


def in_frame(name: str, foreign: ForeignGrasps, model: ObjectModel) -> ForeignGrasps:
    """Grasps for one size in the frame of our object; DmfcError where it has another size."""
    if name == "graspit":
        return foreign
    return (dexgraspnet if name == "dexgraspnet" else dexgraspbench).in_frame(foreign, model)


def files_of(name: str, paths: Sequence[Path]) -> list[Path]:
    """Files of a format: those given, and those below folders. Raises DmfcError where is none."""
    if name not in FORMATS:
        raise unknown_name("format", name, FORMATS)
    suffix, found = FORMATS[name], list[Path]()
    for path in paths:
        found += files_below(path, [suffix]) if path.is_dir() else [path]
    if not found:
        raise DmfcError(f"no {suffix} file in {', '.join(map(str, paths)) or 'no path'}")
    return found
