"""What made a sweep: code, packages, processor. A line per call that ran stages of it."""

from __future__ import annotations

import logging
import os
import platform
import subprocess
import sys
import time
from functools import cache
from importlib.metadata import distributions
from pathlib import Path
from typing import Any

from dmfc.errors import masked
from dmfc.files.atomic import write_bytes
from dmfc.files.digest import file_digest
from dmfc.files.sealed import read_or_replace, write_sealed

_LOG = logging.getLogger(__name__)
SEALED_VERSION = 2
"""Earlier files are a bare list of calls."""
PROVENANCE = "provenance.json"
VECTOR_FLAGS = ("avx", "amx", "sve")
"""Beginnings of the processor's flags by which floating point results can differ."""
DIFF_BYTES = 2**20
"""A longer diff of uncommitted changes is cut."""


def add_provenance(folder: Path) -> None:
    """Add this call to the sweep's provenance, and its uncommitted changes as a file beside it."""
    calls = read_provenance(folder)
    call: dict[str, Any] = {
        "started": round(time.time(), 3),
        "command": [masked(word) for word in sys.argv[1:]],
        "host": platform.node(),
        "python": platform.python_version(),
        "commit": git_commit(),
        "packages": dict(_packages()),
        **_processor(),
    }
    diff = _git("diff", "HEAD")
    if diff:
        name = f"dirty-{len(calls)}.diff"
        write_bytes(folder / name, diff.encode()[:DIFF_BYTES])
        call |= {"diff": name, "diff_sha256": file_digest(folder / name)}
    write_sealed(folder / PROVENANCE, SEALED_VERSION, {"calls": [*calls, call]})


def read_provenance(folder: Path) -> list[dict[str, Any]]:
    """The calls that ran stages of the sweep, the latest last.

    A damaged file is set aside, with a warning: what came before is then not known here.
    """
    stored = read_or_replace(folder / PROVENANCE, SEALED_VERSION) or []
    calls = stored["calls"] if isinstance(stored, dict) else stored
    for call in calls:
        path = folder / call.get("diff", "")
        known = call.get("diff_sha256")
        if known and not (path.is_file() and file_digest(path) == known):
            _LOG.warning("'%s' is not what was written: do not trust it", path)
    return calls


@cache
def _packages() -> tuple[tuple[str, str], ...]:
    """Names and versions of what is installed; reading them takes a second or two."""
    return tuple(sorted((item.name, item.version) for item in distributions()))


def git_commit() -> str:
    """The commit of the checkout that this code is in, with '-dirty'; empty where it is in none."""
    return _git("describe", "--always", "--dirty", "--abbrev=40").strip()


def _git(*arguments: str) -> str:
    try:
        answer = subprocess.run(
            ["git", *arguments],
            cwd=Path(__file__).parent,
            capture_output=True,
            text=True,
            errors="replace",
            timeout=10,
            check=False,
        )
    except (OSError, subprocess.TimeoutExpired):
        return ""
    return answer.stdout if answer.returncode == 0 else ""


def _processor() -> dict[str, Any]:
    """Model and instruction sets of the processor, and how many of it there are."""
    found: dict[str, Any] = {"cpus": os.cpu_count(), "processor": platform.processor(), "flags": ""}
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return found
    for line in reversed(lines):
        name, _, value = (part.strip() for part in line.partition(":"))
        if name in ("model name", "flags"):
            found["processor" if name == "model name" else "flags"] = value
    return found
