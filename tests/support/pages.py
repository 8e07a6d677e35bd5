"""The files and commands that a page of docs prints."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

DOCS = Path(__file__).resolve().parents[2] / "docs"
_FILE = re.compile(r"^`([\w./]+)`:\n\n```\w+\n(.*?)^```$", re.MULTILINE | re.DOTALL)
_SHELL = re.compile(r"^```sh\n(.*?)^```$", re.MULTILINE | re.DOTALL)


def files(page: str) -> dict[str, str]:
    """Contents by name: blocks that follow a line such as '`my_losses.py`:'."""
    return dict(_FILE.findall((DOCS / page).read_text()))


def write_files(page: str, folder: Path) -> None:
    for name, content in files(page).items():
        (folder / name).write_text(content)


def commands(page: str) -> str:
    """All blocks of shell commands, in the page's order, as one script."""
    return "".join(_SHELL.findall((DOCS / page).read_text()))


def run(page: str, folder: Path) -> str:
    """Run the page's commands in `folder` as a reader does; gives what they print."""
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    done = subprocess.run(
        ["bash", "-e", "-c", commands(page)],
        capture_output=True,
        text=True,
        cwd=folder,
        env={**os.environ, "PATH": path, "PYTHONPATH": str(DOCS.parent)},
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert "Traceback" not in done.stderr
    return done.stdout
