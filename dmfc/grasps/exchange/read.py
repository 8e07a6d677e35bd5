"""The formats by name, and the files of a path."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from dmfc.errors import DmfcError, unknown_name
from dmfc.grasps.exchange import dexgraspbench, dexgraspnet, graspit
from dmfc.grasps.exchange.convert import ForeignGrasps
from dmfc.grasps.exchange.hand_map import HandMap
from dmfc.objects.model import ObjectModel

FORMATS = {
    "graspit": graspit.SUFFIX,
    "dexgraspnet": dexgraspnet.SUFFIX,
    "dexgraspbench": dexgraspbench.SUFFIX,
}
"""Format -> suffix of its files."""


def read_foreign(
    name: str,
    paths: Sequence[Path],
    hand_map: HandMap,
    model: ObjectModel,
    scale: float | None = None,
) -> ForeignGrasps:
    """The grasps in files, or in all files below folders, in order of their names.

    `scale` picks the size of the object in a format that holds several (DexGraspNet). Raises
    DmfcError for an unknown format, and naming the file that is missing or something else.
    """
    if name not in FORMATS:
        raise unknown_name("format", name, FORMATS)
    files = _files(paths, FORMATS[name])
    if scale is not None and name != "dexgraspnet":
        raise DmfcError(f"--scale is of dexgraspnet alone; {name} says what size it means")
    if name == "graspit":
        return graspit.read(files)
    if name == "dexgraspnet":
        return dexgraspnet.read(files, list(hand_map.joints), scale)
    return dexgraspbench.read(files, model)


def _files(paths: Sequence[Path], suffix: str) -> list[Path]:
    found: list[Path] = []
    for path in paths:
        found += sorted(path.rglob(f"*{suffix}")) if path.is_dir() else [path]
    if not found:
        raise DmfcError(f"no {suffix} file in {', '.join(map(str, paths)) or 'no path'}")
    return found
