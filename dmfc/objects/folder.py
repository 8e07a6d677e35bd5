"""The user's own mesh files: the selector `folder:PATH?unit=mm&scale=0.06&file=NAME`."""

from __future__ import annotations

import functools
import hashlib
import math
import re
from dataclasses import dataclass
from pathlib import Path

from dmfc.errors import DmfcError
from dmfc.files.below import files_below
from dmfc.geometry.units import UNITS
from dmfc.objects.source import ObjectSource, as_name


@dataclass(frozen=True)
class _Asked:
    """What a selector says."""

    path: Path
    unit: str = "m"
    scale: str = ""
    """As it is written: it becomes part of the id."""
    file: str = ""
    """The one mesh of a folder, relative to it."""

    @property
    def factor(self) -> float:
        """Metres per unit of the file."""
        return UNITS[self.unit] * float(self.scale or 1)

    def selector(self, file: str) -> str:
        """Selects one of the meshes, with the id that it has here."""
        options = [f"unit={self.unit}"] if self.unit != "m" else []
        options += [f"scale={self.scale}"] if self.scale else []
        options += [f"file={file}"] if self.path.is_dir() else []
        return f"folder:{self.path}" + ("?" + "&".join(options) if options else "")


def folder_sources(rest: str, selector: str) -> list[ObjectSource]:
    """The objects of a selector 'folder:rest': a mesh file, or all in a folder and below.

    The id is folder/ and the file's path below the folder, without suffix, letters of any script
    kept; with a scale, that follows, since one mesh in two sizes is two objects. Raises DmfcError
    where there is no mesh, or an option is wrong.
    """
    from dmfc.objects.mesh_file import MESH_SUFFIXES, load_mesh

    asked = _asked(rest, selector)
    folder = asked.path if asked.path.is_dir() else asked.path.parent
    files = [asked.path] if asked.path.is_file() else files_below(asked.path, MESH_SUFFIXES)
    if asked.file:
        files = [file for file in files if file.relative_to(folder).as_posix() == asked.file]
    if not files or any(file.suffix.lower() not in MESH_SUFFIXES for file in files):
        kinds = " ".join(MESH_SUFFIXES)
        raise DmfcError(f"object selector '{selector}': no mesh file there (formats: {kinds})")
    sources = []
    for file in files:
        relative = file.relative_to(folder)
        try:
            content = hashlib.sha256(file.read_bytes()).hexdigest()
        except OSError as error:
            raise DmfcError(f"object selector '{selector}': {error}") from error
        content += f" {file.suffix} {asked.factor}"
        name = as_name(relative.with_suffix("").as_posix())
        sources.append(
            ObjectSource(
                id=f"folder/{name}" + (f"-{asked.scale}" if asked.scale else ""),
                licence="user's own",
                mass=None,
                digest=hashlib.sha256(content.encode()).hexdigest(),
                selector=asked.selector(relative.as_posix()),
                loader=functools.partial(load_mesh, [file], asked.factor),
            )
        )
    return sources


def scaled(selector: str, scale: float) -> str | None:
    """A selector of the user's own meshes with their size; None where it says its unit or size, or
    is of other objects."""
    head, _, rest = selector.partition(":")
    if head != "folder":
        return None
    asked = _asked(rest, selector)
    if asked.scale or "?unit=" in rest:
        return None
    return _Asked(asked.path, scale=f"{scale:g}", file=asked.file).selector(asked.file)


def _asked(rest: str, selector: str) -> _Asked:
    """The path and the options; a path may have a '?' in it."""
    path = Path(rest).expanduser().absolute()
    if path.exists():
        return _Asked(path)
    text, question, options = rest.rpartition("?")
    if not question:
        raise DmfcError(f"object selector '{selector}': {path} does not exist")
    pattern = r"(?:unit=(?P<unit>\w+))?&?(?:scale=(?P<scale>[^&]+))?&?(?:file=(?P<file>.+))?"
    match = re.fullmatch(pattern, options)
    given = match.groupdict() if match else {}
    unit = given.get("unit") or "m"
    if not any(given.values()) or unit not in UNITS:
        raise DmfcError(
            f"object selector '{selector}': expected ?unit= one of {', '.join(UNITS)}, or ?scale="
        )
    path = Path(text).expanduser().absolute()
    if not path.exists():
        raise DmfcError(f"object selector '{selector}': {path} does not exist")
    scale = given.get("scale") or ""
    if scale and not _is_size(scale):
        raise DmfcError(f"object selector '{selector}': scale={scale} is not a size above 0")
    return _Asked(path, unit, scale, given.get("file") or "")


def _is_size(text: str) -> bool:
    try:
        return math.isfinite(float(text)) and float(text) > 0
    except ValueError:
        return False
