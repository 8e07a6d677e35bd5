"""Point Cloud Data files of PCL, version 0.7: `DATA ascii` and `DATA binary`, strictly read."""

from __future__ import annotations

from pathlib import Path

import numpy as np

_KINDS = {"F": "f", "I": "i", "U": "u"}
_KEYS = ("FIELDS", "SIZE", "TYPE", "COUNT", "POINTS", "DATA")
_HEADER_LINES = 40


def read_pcd(path: Path) -> np.ndarray:
    """The fields x, y, z of a file as [N, 3] float64. Raises ValueError where it is not as told."""
    content = path.read_bytes()
    header, body = _header(content)
    count = int(header["POINTS"][0])
    columns = _columns(header)
    names = [name for name, _, _ in columns]
    for axis in "xyz":
        if names.count(axis) != 1:
            raise ValueError(f"it has the fields {' '.join(names)}, not x, y and z")
    data = header["DATA"][0].lower()
    if data == "ascii":
        return _ascii(body, columns, count)
    if data == "binary":
        return _binary(body, columns, count)
    raise ValueError(f"DATA {data} is not read; save it as ascii or binary")


Column = tuple[str, str, int]
"""Name, numpy type, and how many values."""


def _header(content: bytes) -> tuple[dict[str, list[str]], bytes]:
    """Entries up to and with DATA, and what follows them."""
    header: dict[str, list[str]] = {}
    rest = content
    for _ in range(_HEADER_LINES):
        line, found, rest = rest.partition(b"\n")
        words = line.decode("ascii", "replace").split("#")[0].split()
        if words:
            header[words[0]] = words[1:]
        if "DATA" in header or not found:
            break
    fields = len(header.get("FIELDS", []))
    header.setdefault("COUNT", ["1"] * fields)
    missing = [key for key in _KEYS if not header.get(key)]
    if missing:
        raise ValueError(f"its header lacks {', '.join(missing)}")
    return header, rest


def _columns(header: dict[str, list[str]]) -> list[Column]:
    try:
        return [
            (name, f"<{_KINDS[kind]}{int(size)}", int(count))
            for name, size, kind, count in zip(
                header["FIELDS"], header["SIZE"], header["TYPE"], header["COUNT"], strict=True
            )
        ]
    except (KeyError, ValueError) as error:
        raise ValueError("FIELDS, SIZE, TYPE and COUNT of its header do not fit") from error


def _ascii(body: bytes, columns: list[Column], count: int) -> np.ndarray:
    width = sum(values for _, _, values in columns)
    numbers = np.array(body.split(), dtype=np.float64)
    if len(numbers) != count * width:
        raise ValueError(f"it holds {len(numbers)} numbers, not the {count} x {width} it promises")
    starts = np.cumsum([0, *(values for _, _, values in columns)])
    names = [name for name, _, _ in columns]
    return numbers.reshape(count, width)[:, [starts[names.index(axis)] for axis in "xyz"]]


def _binary(body: bytes, columns: list[Column], count: int) -> np.ndarray:
    # Padding fields are all called "_", which numpy refuses: fields are named by their place.
    row = np.dtype([(f"{k}", kind, (n,)) for k, (_, kind, n) in enumerate(columns)])
    if len(body) < count * row.itemsize:
        raise ValueError(f"it holds {len(body)} bytes, not the {count * row.itemsize} it promises")
    rows = np.frombuffer(body, row, count)
    names = [name for name, _, _ in columns]
    return np.stack(
        [rows[f"{names.index(axis)}"][:, 0].astype(np.float64) for axis in "xyz"], axis=1
    )
