"""Finished stages and sweeps as one archive, which another store verifies and imports.

The archive is a tar (compressed if its name ends in .gz) that begins with `manifest.json`: the
addresses of its stages, the digest of every file in it, and how many bytes they have in all.
"""

from __future__ import annotations

import io
import json
import shutil
import tarfile
import uuid
import zlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from pyarrow.fs import FileType

from dmfc.engine.ledger import Ledger
from dmfc.engine.record import RECORD, faults, read_record
from dmfc.engine.state import SEALED_VERSION
from dmfc.engine.store import verify
from dmfc.engine.unpack import MANIFEST, unpacked
from dmfc.errors import DmfcError, first_line
from dmfc.files.atomic import move, written_whole
from dmfc.files.digest import damage, folder_digests
from dmfc.files.sealed import read_sealed
from dmfc.files.storage import located

VERSION = 1
COPY_BYTES = 2**22
"""Read and written at once on the way to a URL."""


@dataclass(frozen=True)
class Imported:
    """What an archive brought: stages that are new here, stages that were here, sweeps."""

    stages: list[str]
    known: list[str]
    sweeps: list[str]


@contextmanager
def fetched(ledger: Ledger, place: str) -> Iterator[Path]:
    """The archive at a path or URL as a local file, while the context lasts.

    Raises DmfcError if it is not there or cannot be read.
    """
    if "://" not in place:
        if not Path(place).is_file():
            raise DmfcError(f"archive '{place}' does not exist")
        yield Path(place)
        return
    with _temporary(ledger, place) as path:
        _transfer(place, str(path))
        yield path


def export_to(
    ledger: Ledger, addresses: Iterable[str], sweep_ids: Sequence[str], place: str
) -> int:
    """As `export`, to a path or a URL; a URL is written once the archive is whole."""
    if "://" not in place:
        return export(ledger, addresses, sweep_ids, Path(place))
    try:
        system, path = located(place)
        taken = system.get_file_info(path).type != FileType.NotFound
    except OSError as error:
        raise DmfcError(f"{place} cannot be reached: {first_line(error)}") from error
    if taken:
        raise DmfcError(f"'{place}' exists already: remove it, or give another name")
    with _temporary(ledger, place) as local:
        count = export(ledger, addresses, sweep_ids, local)
        _transfer(str(local), place)
    return count


@contextmanager
def _temporary(ledger: Ledger, place: str) -> Iterator[Path]:
    """A name for the archive in the store's work folder, removed at the end."""
    ledger.prepare()
    path = ledger.store / "work" / f"archive-{uuid.uuid4().hex[:8]}-{place.rpartition('/')[2]}"
    try:
        yield path
    finally:
        path.unlink(missing_ok=True)


def _transfer(source: str, target: str) -> None:
    try:
        (system, path), (other, to) = located(source), located(target)
        with system.open_input_stream(path) as given, other.open_output_stream(to) as taken:
            shutil.copyfileobj(given, taken, COPY_BYTES)
    except OSError as error:
        line = first_line(error)
        raise DmfcError(f"{source} was not copied to {target}: {line}") from error


def export(
    ledger: Ledger, addresses: Iterable[str], sweep_ids: Sequence[str], archive: Path
) -> int:
    """Write stages and sweeps into `archive`, whole or not at all; the number of stages.

    Raises DmfcError if a stage is damaged, nothing is to be written, or `archive` is there.
    """
    stages = sorted(addresses)
    if not stages:
        raise DmfcError("nothing to export: no stage of these sweeps is finished")
    if archive.exists():
        raise DmfcError(f"'{archive}' exists already: remove it, or give another name")
    for address, wrong in verify(ledger, stages):
        if wrong:
            raise DmfcError(f"{address} cannot be exported: {wrong[0]} (dmfc store verify)")
    folders = [f"stages/{address}" for address in stages]
    folders += [f"sweeps/{sweep_id}" for sweep_id in sweep_ids]
    digests = {name: _digests(ledger.store / name) for name in folders}
    names = [f"{folder}/{name}" for folder, files in digests.items() for name in files]
    listing = {"version": VERSION, "stages": stages, "folders": digests}
    listing["bytes"] = sum((ledger.store / name).stat().st_size for name in names)
    manifest = json.dumps(listing, indent=1).encode()
    mode: Literal["w:gz", "w"] = "w:gz" if archive.suffix == ".gz" else "w"
    try:
        with written_whole(archive) as temporary, tarfile.open(temporary, mode) as tar:
            head = tarfile.TarInfo(MANIFEST)
            head.size = len(manifest)
            tar.addfile(head, io.BytesIO(manifest))
            for name in names:
                tar.add(ledger.store / name, name)
    except OSError as error:
        raise DmfcError(f"'{archive}' was not written: {error}") from error
    return len(stages)


def take_in(ledger: Ledger, archive: Path) -> Imported:
    """Add an archive's stages and sweeps to a store: all of them, or nothing.

    Everything is checked before anything is added: the archive's digests, and those that its stages
    hold. A stage that is here already stays as it is, and a sweep's own files too.
    Raises DmfcError where the archive is damaged, unsafe (links, absolute paths, '..'), larger than
    it says or than the disk has room for, or of something else.
    """
    ledger.prepare()
    staging = ledger.store / "work" / f"import-{uuid.uuid4().hex[:8]}"
    staging.mkdir()
    try:
        stages, sweeps = _check(staging, archive, unpacked(archive, staging))
        return _adopt(ledger, staging, stages, sweeps)
    except tarfile.ReadError as error:
        raise DmfcError(f"'{archive}' is not a tar archive, or it is damaged") from error
    except (OSError, tarfile.TarError, EOFError, zlib.error) as error:
        raise DmfcError(f"'{archive}' was not taken in: {error}") from error
    finally:
        shutil.rmtree(staging, ignore_errors=True)


def _check(
    staging: Path, archive: Path, manifest: Mapping[str, Any]
) -> tuple[list[str], list[str]]:
    """Addresses of the stages and ids of the sweeps, after comparing every file and key."""
    if manifest.get("version") != VERSION:
        raise DmfcError(
            f"'{archive}' has version {manifest.get('version')}; this dmfc reads {VERSION}"
        )
    stages, folders = list(manifest["stages"]), dict(manifest["folders"])
    for folder, digests in folders.items():
        parts = Path(folder).parts
        if not parts or len(parts) != {"stages": 3, "sweeps": 2}.get(parts[0]) or ".." in parts:
            raise DmfcError(f"'{archive}': unexpected folder '{folder}'")
        for name, how in damage(staging / folder, digests):
            raise DmfcError(f"'{archive}' is damaged: {folder}/{name} {how}")
    if {f"stages/{address}" for address in stages} != {f for f in folders if f[:7] == "stages/"}:
        raise DmfcError(f"'{archive}': its manifest lists other stages than it has digests of")
    for address in stages:
        folder = staging / "stages" / address
        if read_record(folder).get("kind") != address.partition("/")[0]:
            raise DmfcError(f"'{archive}': the record of {address} is of another kind")
        for name, how in faults(folder):
            raise DmfcError(f"'{archive}': in {address} {name} {how}")
    sweeps = [name.partition("/")[2] for name in folders if name.startswith("sweeps/")]
    for name in sweeps:
        plan = read_sealed(staging / "sweeps" / name / "sweep.json", SEALED_VERSION)
        if not isinstance(plan, dict) or plan.get("id") != name:
            raise DmfcError(f"'{archive}': the plan in sweeps/{name} is of another sweep")
    return stages, sweeps


def _adopt(ledger: Ledger, staging: Path, stages: list[str], sweeps: list[str]) -> Imported:
    """Move what was checked into the store; if that fails, take out again what it brought."""
    added: list[str] = []
    moved: list[Path] = []
    try:
        for address in stages:
            with ledger.lock(address):
                if not ledger.finished(address):
                    ledger.adopt(address, staging / "stages" / address)
                    added.append(address)
        for name in sweeps:
            target = ledger.store / "sweeps" / name
            if not target.exists():
                move(staging / "sweeps" / name, target)
                moved.append(target)
    except BaseException:
        for target in moved:
            shutil.rmtree(target, ignore_errors=True)
        for address in added:
            with ledger.lock(address):
                ledger.remove(address)
        raise
    return Imported(added, [address for address in stages if address not in added], sweeps)


def _digests(folder: Path) -> dict[str, str]:
    """Digests of all files of a folder, the record first."""
    found = folder_digests(folder)
    first = {RECORD: found.pop(RECORD)} if RECORD in found else {}
    return first | found
