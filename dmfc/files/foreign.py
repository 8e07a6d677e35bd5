"""Files that others wrote: whatever their parsers raise is one line that names the file."""

from __future__ import annotations

import contextlib
import warnings
from collections.abc import Iterator
from pathlib import Path

from dmfc.errors import DmfcError, one_line


@contextlib.contextmanager
def reading(path: Path, what: str, option: str = "") -> Iterator[None]:
    """Encloses a third party's parser at work on the file `path`, which should be `what`.

    Bytes that nobody can vouch for make parsers raise anything, EOFError and MemoryError included.
    Raises DmfcError where the file is missing, a folder or empty, and for every error inside.
    `option`: the one that named the file, for the message.
    """
    hint = f" ({option})" if option else ""
    _require_content(path, hint)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # a parser's doubts are no lines of ours
            yield
    except (DmfcError, ModuleNotFoundError):
        raise
    except Exception as error:
        text = one_line(error) or type(error).__name__
        raise DmfcError(f"{path} cannot be read as {what}: {text}{hint}") from error


def _require_content(path: Path, hint: str) -> None:
    try:
        if path.is_dir():
            raise DmfcError(f"'{path}' is a folder, not a file{hint}")
        if not path.is_file():
            raise DmfcError(f"there is no file '{path}'{hint}")
        if not path.stat().st_size:
            raise DmfcError(f"the file '{path}' is empty: it has 0 bytes{hint}")
    except (OSError, ValueError) as error:  # a name that no system takes
        raise DmfcError(f"the file '{path}' cannot be opened: {error}{hint}") from error
