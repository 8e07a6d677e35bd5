"""The cache of unpacked packs.

`<cache>/packs/<name>-<hash>/` holds `manifest.json` and `files/`; the hash is of the pin and of the
folder that is kept, so another pin is another folder. A pack is unpacked beside it and renamed:
what stands there is complete. Environment DMFC_CACHE moves the cache.
"""

from __future__ import annotations

import functools
import hashlib
import json
import os
import shutil
import tempfile
from pathlib import Path
from typing import Literal

from filelock import FileLock
from platformdirs import user_cache_dir

from dmfc.assets.download import download
from dmfc.assets.packs import Pack, get_pack
from dmfc.assets.unpack import unpack
from dmfc.errors import DmfcError, one_line

_VERSION = 1
PackStatus = Literal["cached", "missing"]


def cache_dir() -> Path:
    """The cache's folder: environment DMFC_CACHE, else the user's cache folder of the platform."""
    return Path(os.environ.get("DMFC_CACHE") or user_cache_dir("dmfc")).expanduser().absolute()


def status(name: str) -> PackStatus:
    """Whether a pack is in the cache (its files are not hashed)."""
    return "cached" if (_folder(get_pack(name)) / "manifest.json").is_file() else "missing"


def pull(name: str) -> Path:
    """The folder of the unpacked pack, downloaded on the first call, offline afterwards.

    Its files are compared with the manifest once per process. Raises DmfcError for an unknown
    name, when pip cannot fetch it, and when the cached copy is damaged.
    """
    pack = get_pack(name)
    folder = _folder(pack)
    if not folder.is_dir():
        _fetch(pack, folder)
    _verified(pack, folder)
    return folder / "files"


def verify(name: str) -> int:
    """Hash every file of a cached pack; the number of files. DmfcError if missing or damaged."""
    pack = get_pack(name)
    folder = _folder(pack)
    if not folder.is_dir():
        raise DmfcError(f"asset pack '{name}' is not in the cache; run 'dmfc assets pull {name}'")
    return _check(pack, folder)


@functools.cache
def _verified(pack: Pack, folder: Path) -> int:
    return _check(pack, folder)


def _folder(pack: Pack) -> Path:
    content = json.dumps([_VERSION, pack.sha256, pack.subfolder, pack.suffixes])
    return (
        cache_dir() / "packs" / f"{pack.name}-{hashlib.sha256(content.encode()).hexdigest()[:12]}"
    )


def _fetch(pack: Pack, folder: Path) -> None:
    """Download and unpack into a temporary folder, then rename it; one process at a time."""
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        with FileLock(f"{folder}.lock"):
            if folder.is_dir():
                return
            temporary = Path(tempfile.mkdtemp(prefix=f".{pack.name}-", dir=folder.parent))
            try:
                archive = download(pack, temporary)
                ready = temporary / "ready"
                names = unpack(archive, pack, ready / "files")
                _write_manifest(pack, ready, names)
                ready.rename(folder)
            finally:
                shutil.rmtree(temporary, ignore_errors=True)
    except OSError as error:
        raise DmfcError(
            f"asset pack '{pack.name}' cannot be cached under {cache_dir()}: {error} "
            "(environment DMFC_CACHE moves the cache)"
        ) from error


def _write_manifest(pack: Pack, folder: Path, names: list[str]) -> None:
    manifest = {
        "version": _VERSION,
        "pack": pack.name,
        "requirement": pack.requirement,
        "sha256": pack.sha256,
        "licence": pack.licence,
        "files": {name: _sha256(folder / "files" / name) for name in names},
    }
    (folder / "manifest.json").write_text(json.dumps(manifest, indent=1), encoding="utf-8")


def _check(pack: Pack, folder: Path) -> int:
    try:
        recorded = json.loads((folder / "manifest.json").read_text(encoding="utf-8"))["files"]
        for name, digest in recorded.items():
            if _sha256(folder / "files" / name) != digest:
                raise ValueError(f"'{name}' has changed")
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise DmfcError(
            f"asset pack '{pack.name}' is corrupt: {_what(error)}; delete {folder} and run "
            f"'dmfc assets pull {pack.name}'"
        ) from error
    return len(recorded)


def _what(error: Exception) -> str:
    if isinstance(error, FileNotFoundError):
        return f"'{Path(str(error.filename)).name}' is missing"
    return one_line(error)


def _sha256(path: Path) -> str:
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()
