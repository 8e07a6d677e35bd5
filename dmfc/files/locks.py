"""Whether somebody holds a lock, asked without keeping it."""

from __future__ import annotations

import fcntl
from pathlib import Path

from filelock import FileLock, Timeout


def is_held(path: Path) -> bool:
    """Whether a living process holds the FileLock at `path`; where nothing can be written too."""
    try:
        with FileLock(path, timeout=0):
            return False
    except Timeout:
        return True
    except OSError:
        return _held_by_another(path)


def _held_by_another(path: Path) -> bool:
    """The same by a file that can only be read."""
    try:
        with path.open("rb") as file:
            fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except OSError:
        return False  # there is no such lock
    return False
