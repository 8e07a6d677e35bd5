"""Options that name what is written: checked while the line is parsed, before any work."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import typer

from dmfc.errors import DmfcError

Check = Callable[[typer.CallbackParam, Path | None], Path | None]


def file_to_write(*suffixes: str) -> Check:
    """A callback for an option of a file; `suffixes` that it may have, any if there are none.

    Raises DmfcError where the file cannot be written; its folder may be missing (see `made`).
    """

    def check(param: typer.CallbackParam, value: Path | None) -> Path | None:
        if value is not None:
            option = _name(param)
            if suffixes and value.suffix.lower() not in suffixes:
                raise DmfcError(f"{option} {value}: its name ends in {' or '.join(suffixes)}")
            _check_place(value.parent, option, value)
            if value.is_dir():
                raise DmfcError(f"{option} {value}: that is a folder, a file is needed")
        return value

    return check


def folder_to_write() -> Check:
    """A callback for an option of a folder, which may be missing.

    Raises DmfcError where it cannot be made or written to.
    """

    def check(param: typer.CallbackParam, value: Path | None) -> Path | None:
        if value is not None:
            _check_place(value, _name(param), value)
        return value

    return check


def made(path: Path) -> Path:
    """The path of a file, whose folder is there now."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise DmfcError(f"{path} cannot be written: {error.strerror}") from error
    return path


def _name(param: typer.CallbackParam) -> str:
    """'--out', or the metavariable of an argument."""
    name = max(param.opts, key=len)
    return name if name.startswith("-") else name.upper()


def _check_place(folder: Path, option: str, value: Path) -> None:
    """The folder, or the nearest above it that is there, takes files."""
    try:
        there = next(place for place in (folder, *folder.absolute().parents) if place.exists())
    except (OSError, ValueError) as error:  # a name that no system takes
        raise DmfcError(f"{option} {value}: no such place can be made: {error}") from error
    if not there.is_dir():
        raise DmfcError(f"{option} {value}: {there} is a file, not a folder")
    if not os.access(there, os.W_OK | os.X_OK):
        raise DmfcError(f"{option} {value}: the folder {there} cannot be written")
