"""The error that a user sees: one line that says what, why and which setting."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable

_USER = re.compile(r"([A-Za-z][A-Za-z0-9+.-]*://)(?:[^\s/?#@:]*:\S*|[^\s/?#@]+)@")
_WORD = r"(?:pass(?:word|wd)?|pwd|(?:[a-z_]*[_-])?(?:token|secret|key))"
_PARAMETER = re.compile(rf"([?&;]{_WORD}=)[^&;#\s'\"]+", re.IGNORECASE)


def masked(text: str) -> str:
    """`text` with the user, password or token in each URI of it replaced by `***`."""
    return _PARAMETER.sub(r"\1***", _USER.sub(r"\1***@", text))


EXTRAS = {
    "sim": {
        *("pytorch_kinematics", "mujoco", "trimesh", "coacd", "fcl", "embreex", "igl"),
        *("manifold3d", "fast_simplification", "rtree", "networkx", "pyarrow", "pandas"),
    },
    "train": {"lightning"},
    "sweep": {"ray", "optuna", "mlflow", "sqlalchemy", "filelock", "psutil", "jinja2"},
}
"""Top-level modules of the packages that each extra in pyproject.toml adds."""


class DmfcError(Exception):
    """A failure that is explained to the user on one line, without a traceback.

    Passwords in URIs are masked.
    """

    def __init__(self, text: str) -> None:
        super().__init__(masked(text))


class MachineError(DmfcError):
    """A failure of the machine (network, cache, disk, memory, missing program), not of the work.

    Another machine may do the same work, so nothing of it is recorded as a result.
    """


MACHINE_ERRORS = (MachineError, OSError, MemoryError, ImportError)


def of_machine(error: BaseException) -> bool:
    """Whether `error`, or what it was raised from, is a failure of the machine."""
    cause: BaseException | None = error
    while cause is not None:
        if isinstance(cause, MACHINE_ERRORS):
            return True
        cause = cause.__cause__
    return False


def first_line(error: BaseException) -> str:
    """The first line of an error's text; the name of its type where it has no text."""
    lines = str(error).strip().splitlines()
    return lines[0] if lines else type(error).__name__


def one_line(error: BaseException, most: int = 200) -> str:
    """All of an error's text on one line, up to `most` characters; its type where it has none."""
    return " ".join(str(error).split())[:most] or type(error).__name__


def unknown_name(what: str, name: str, choices: Iterable[str]) -> DmfcError:
    """The error for a name that is not among `choices`: names the nearest one, then all of them."""
    choices = sorted(choices)
    near = difflib.get_close_matches(name, choices, n=1, cutoff=0.4)
    hint = f"; did you mean '{near[0]}'?" if near else ""
    listed = ", ".join(choices[:20]) + (", ..." if len(choices) > 20 else "")
    return DmfcError(f"unknown {what} '{name}'{hint} (choices: {listed})")


def missing_package(error: ModuleNotFoundError) -> DmfcError | None:
    """The error for a package that an extra of dmfc installs; None for another module."""
    package = (error.name or "").partition(".")[0]
    extra = next((name for name, packages in EXTRAS.items() if package in packages), None)
    if extra is None:
        return None
    return DmfcError(
        f"this needs the package '{package}', which is not installed: pip install 'dmfc[{extra}]'"
    )
