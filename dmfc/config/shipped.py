"""YAML files that are shipped with dmfc: presets, protocols and sweeps."""

from __future__ import annotations

from pathlib import Path

from dmfc.errors import DmfcError, unknown_name

RENAMED = {
    ("configs", "paper"): "full",
    ("configs", "hour"): "medium",
    ("protocols", "paper"): "default",
}
"""Folder and former name of a file -> its name."""


def shipped_names(folder: str) -> list[str]:
    """Names of the YAML files shipped in `folder` ('configs', 'sweeps' or 'protocols')."""
    return sorted(path.stem for path in _shipped_folder(folder).glob("*.yaml"))


def shipped_file(folder: str, name: str, what: str) -> Path:
    """The path of a shipped YAML file by its name, or of the user's own by its path."""
    path = Path(name)
    if path.suffix in (".yaml", ".yml") or len(path.parts) > 1:
        if path.is_file():
            return path
        shipped = _shipped_folder(folder) / path.name
        if path.parts[:-1] == (folder,) and shipped.is_file():
            return shipped
        raise DmfcError(f"{what} file '{name}' does not exist")
    check_renamed(folder, name, what)
    shipped = _shipped_folder(folder) / f"{name}.yaml"
    if not shipped.is_file():
        raise unknown_name(what, name, shipped_names(folder))
    return shipped


def check_renamed(folder: str, name: str, what: str) -> None:
    """Raises DmfcError, with the new name, on the former name of a shipped file."""
    if (folder, name) in RENAMED:
        raise DmfcError(f"{what} '{name}' is now called '{RENAMED[folder, name]}'")


def _shipped_folder(folder: str) -> Path:
    """`folder` inside an installed wheel, or at the top of a checkout."""
    package = Path(__file__).resolve().parents[1]
    for candidate in (package / folder, package.parent / folder):
        if candidate.is_dir():
            return candidate
    raise DmfcError(f"this installation of dmfc has no folder '{folder}': install it again")
