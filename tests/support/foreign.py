"""What readers of foreign bytes must do: give an object, or an error of one line."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

from dmfc.errors import DmfcError

T = TypeVar("T")


def attempted(read: Callable[[], T]) -> tuple[T | None, str]:
    """(what is read, "") or (None, the error); anything but a DmfcError of one line fails."""
    try:
        return read(), ""
    except DmfcError as error:
        message = str(error)
    if not message or "\n" in message or len(message) > 2000:
        raise AssertionError(f"not an error of one line: {message!r}")
    return None, message
