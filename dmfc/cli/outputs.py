"""Options that name what is written: checked while the line is parsed, before any work."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import typer

from dmfc.errors import DmfcError

Place = TypeVar("Place", Path, str, None)


def file_to_write(*suffixes: str) -> Callable[[typer.CallbackParam, Any], Any]:
    """A callback for an option of a file; `suffixes` that it may have, any if there are none.

    Raises DmfcError where the file cannot be written; its folder may be missing (see `made`).
    """

    def check(param: typer.CallbackParam, value: Place) -> Place:
        path = _local(value)
        if path is not None:
            option = _name(param)
            if suffixes and path.suffix.lower() not in suffixes:
                raise DmfcError(f"{option} {path}: its name ends in {' or '.join(suffixes)}")
            if path.is_dir():
                raise DmfcError(f"{option} {path}: that is a folder, a file is needed")
            _check_place(path.parent, f"{option} {path}")
        return value

    return check


def folder_to_write() -> Callable[[typer.CallbackParam, Any], Any]:
    """A callback for an option of a folder, which may be missing.

    Raises DmfcError where it cannot be made or written to.
    """

    def check(param: typer.CallbackParam, value: Place) -> Place:
        path = _local(value)
        if path is not None:
            _check_place(path, f"{_name(param)} {path}")
        return value

    return check


def folder_to_read() -> Callable[[typer.CallbackParam, Any], Any]:
    """A callback for an option of a folder that is read, and written to where there is need.

    Raises DmfcError where it is a file.
    """

    def check(param: typer.CallbackParam, value: Place) -> Place:
        path = _local(value)
        if path is not None:
            _check_place(path, f"{_name(param)} {path}", writable=False)
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


def _local(value: Path | str | None) -> Path | None:
    """None for a URL, whose place is checked by who writes it."""
    return None if value is None or "://" in str(value) else Path(value)


def _check_place(folder: Path, given: str, writable: bool = True) -> None:
    """The folder, or the nearest above it that is there, takes files."""
    try:
        there = next(place for place in (folder, *folder.absolute().parents) if place.exists())
    except (OSError, ValueError) as error:  # a name that no system takes
        raise DmfcError(f"{given}: the folder cannot be made: {error}") from error
    if not there.is_dir():
        raise DmfcError(f"{given}: {there} is a file, not a folder")
    if writable and not os.access(there, os.W_OK | os.X_OK):
        raise DmfcError(f"{given}: the folder {there} cannot be written")
