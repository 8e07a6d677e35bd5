"""The cache of unpacked packs.

`<cache>/packs/<name>-<hash>/` holds `manifest.json` and `files/`; the hash is of the pin and of the
folder that is kept, so another pin is another folder. A pack is unpacked beside it and renamed:
what stands there is complete. Environment DMFC_CACHE moves the cache. Packs may lie in a second
folder of that form, which several machines see: `share` puts them there, `also_in` reads them.
"""

from __future__ import annotations

import functools
import json
import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Literal

from filelock import FileLock
from platformdirs import user_cache_dir

from dmfc.assets.download import download
from dmfc.assets.packs import Pack, get_pack
from dmfc.assets.unpack import unpack
from dmfc.errors import DmfcError, MachineError, one_line
from dmfc.files.atomic import move, write_json
from dmfc.files.digest import file_digest, text_digest

_VERSION = 1
PackStatus = Literal["cached", "missing"]
_shared: list[Path] = []
"""Further folders of packs, the last one asked first."""


def cache_dir() -> Path:
    """The cache's folder: environment DMFC_CACHE, else the user's cache folder of the platform."""
    return Path(os.environ.get("DMFC_CACHE") or user_cache_dir("dmfc")).expanduser().absolute()


def status(name: str) -> PackStatus:
    """Whether a pack is in the cache (its files are not hashed)."""
    return "cached" if (_folder(get_pack(name)) / "manifest.json").is_file() else "missing"


def pull(name: str) -> Path:
    """The folder of the unpacked pack, downloaded on the first call, offline afterwards.

    Its files are compared with the manifest once per process. Raises DmfcError for an unknown
    name, MachineError when pip cannot fetch it, and when the cached copy is damaged.
    """
    pack = get_pack(name)
    places = [_folder(pack), *(_folder(pack, base) for base in reversed(_shared))]
    folder = next((place for place in places if place.is_dir()), places[0])
    if not folder.is_dir():
        _fetch(pack, folder)
    _verified(pack, folder)
    return folder / "files"


@contextmanager
def also_in(folder: Path) -> Iterator[None]:
    """While it lasts, `pull` takes what the cache does not have from `folder` (see `share`)."""
    _shared.append(folder)
    try:
        yield
    finally:
        _shared.remove(folder)


def share(name: str, folder: Path) -> None:
    """Put a pack into `folder`, where other machines find it, unless it is there.

    Raises as `pull` does, and MachineError where it cannot be written.
    """
    target = _folder(get_pack(name), folder)
    if target.is_dir():
        return
    source = pull(name).parent
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        temporary = Path(tempfile.mkdtemp(prefix=f".{name}-", dir=target.parent))
        try:
            shutil.copytree(source, temporary / "ready")
            (temporary / "ready").rename(target)
        finally:
            shutil.rmtree(temporary, ignore_errors=True)
    except OSError as error:
        if not target.is_dir():  # nor by another process
            raise MachineError(
                f"asset pack '{name}' cannot be put into {target.parent}: {error}"
            ) from error


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


def _folder(pack: Pack, base: Path | None = None) -> Path:
    content = json.dumps([_VERSION, pack.sha256, pack.subfolder, pack.suffixes])
    return (base or cache_dir()) / "packs" / f"{pack.name}-{text_digest(content)[:12]}"


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
                move(ready, folder)
            finally:
                shutil.rmtree(temporary, ignore_errors=True)
    except OSError as error:
        raise MachineError(
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
        "files": {name: file_digest(folder / "files" / name) for name in names},
    }
    write_json(folder / "manifest.json", manifest)


def _check(pack: Pack, folder: Path) -> int:
    try:
        recorded = json.loads((folder / "manifest.json").read_text(encoding="utf-8"))["files"]
        for name, digest in recorded.items():
            if file_digest(folder / "files" / name) != digest:
                raise ValueError(f"'{name}' has changed")
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise MachineError(
            f"asset pack '{pack.name}' is corrupt: {_what(error)}; delete {folder} and run "
            f"'dmfc assets pull {pack.name}'"
        ) from error
    return len(recorded)


def _what(error: Exception) -> str:
    if isinstance(error, FileNotFoundError):
        return f"'{Path(str(error.filename)).name}' is missing"
    return one_line(error)
