"""Mesh files: read, and compared with what the file itself says it holds.

A reader that finds less than that has lost a part of the object, or the file is cut off.
"""

from __future__ import annotations

import io
import re
from pathlib import Path

import trimesh

from dmfc.errors import DmfcError, MachineError, one_line

MESH_SUFFIXES = (".stl", ".obj", ".ply", ".off", ".glb")
_COMPRESSED = (b"KHR_draco_mesh_compression", b"EXT_meshopt_compression")
"""Of `.glb`: the reader leaves out what is compressed so."""


def load_mesh(paths: list[Path], scale: float = 1.0) -> trimesh.Trimesh:
    """Read one mesh from one or more files (joined), times `scale`.

    Raises DmfcError, naming the file, where one is no mesh, or is cut off, and MachineError where
    one is not there.
    """
    parts = [trimesh.Trimesh(p.vertices * scale, p.faces, process=False) for p in map(_read, paths)]
    joined = parts[0]
    for part in parts[1:]:
        joined = joined + part
    return joined


def _read(path: Path) -> trimesh.Trimesh:
    if not path.is_file():
        raise MachineError(f"mesh file {path} does not exist")
    suffix = path.suffix.lower()
    try:
        data = path.read_bytes()
        if not data:
            raise DmfcError("it has 0 bytes")
        rewritten, declared = _declared(data, suffix)
        if rewritten:
            given = io.BytesIO(rewritten)
            part = trimesh.load(given, file_type=suffix[1:], force="mesh", process=False)
        else:
            part = trimesh.load(path, force="mesh", process=False)
    except Exception as error:  # the readers of the formats raise whatever they like
        raise DmfcError(f"mesh file {path} cannot be read: {one_line(error)}") from error
    if not isinstance(part, trimesh.Trimesh):
        raise DmfcError(f"mesh file {path} has no faces")
    faces = len(part.faces)
    if faces < declared:
        raise DmfcError(
            f"mesh file {path} says that it has {declared} faces, and {faces} could be read: "
            "it is cut off or damaged"
        )
    if not faces:
        raise DmfcError(f"mesh file {path} has no faces")
    if part.faces.min() < 0 or part.faces.max() >= len(part.vertices):
        raise DmfcError(f"mesh file {path} is damaged: a face has a vertex that does not exist")
    return part


def _declared(data: bytes, suffix: str) -> tuple[bytes, int]:
    """(the file rewritten for the reader, if it must be; the least number of triangles in it)."""
    if suffix == ".obj":
        return _obj(data)
    if suffix == ".stl":
        return b"", _stl(data)
    if suffix == ".ply":
        found = re.search(rb"^element\s+face\s+(\d+)", data.partition(b"end_header")[0], re.M)
        return b"", int(found.group(1)) if found else 0
    if suffix == ".off":
        text = re.sub(rb"#[^\n]*", b"", data)
        found = re.match(rb"\s*\w*OFF\s+\d+\s+(\d+)", text)
        return b"", int(found.group(1)) if found else 0
    compressed = [name.decode() for name in _COMPRESSED if name in data]
    if compressed:
        raise DmfcError(f"a .glb compressed by {compressed[0]} is not read: export it without")
    return b"", 0


def _stl(data: bytes) -> int:
    """Triangles that an STL file must hold."""
    if data[:5].lower() != b"solid" or b"facet" not in data[:2000].lower():
        return int.from_bytes(data[80:84], "little")
    text = data.lower()
    begun = len(re.findall(rb"^\s*facet\b", text, re.M))
    # A file that breaks off between two triangles has no end.
    return begun if b"endsolid" in text else begun + 1


def _obj(data: bytes) -> tuple[bytes, int]:
    """(the file with absolute numbers, if it has relative ones; number of its triangles).

    trimesh counts relative numbers from the end of the file, and not from where they stand.
    """
    counts = dict.fromkeys((b"v", b"vt", b"vn"), 0)
    lines, triangles, relative, greatest = [], 0, False, 0
    for line in data.replace(b"\\\r\n", b" ").replace(b"\\\n", b" ").splitlines():
        words = line.partition(b"#")[0].split()
        if words and words[0] in counts:
            counts[words[0]] += 1
        elif words and words[0] == b"f":
            triangles += max(0, len(words) - 3)
            relative = relative or any(b"-" in word for word in words)
            corners = [_absolute(word, counts) for word in words[1:]]
            greatest = max([greatest, *(corner[0] for corner in corners)])
            line = b"f " + b" ".join(b"/".join(_text(n) for n in corner) for corner in corners)
        lines.append(line)
    if greatest > counts[b"v"]:
        raise DmfcError(f"a face names vertex {greatest} of {counts[b'v']}")
    return (b"\n".join(lines) if relative else b""), triangles


def _absolute(corner: bytes, counts: dict[bytes, int]) -> list[int]:
    """The numbers of 'vertex/texture/normal', counted from the start of the file; 0: not given."""
    numbers = []
    for word, count in zip(corner.split(b"/"), counts.values(), strict=False):
        number = int(word) if word else 0
        numbers.append(number if number >= 0 else count + 1 + number)
    if numbers[0] < 1:
        raise DmfcError(f"a face names vertex {corner.decode(errors='replace')}")
    return numbers


def _text(number: int) -> bytes:
    return str(number).encode() if number else b""
