"""Finished stages and sweeps as one archive that another store takes in, verified.

The archive is a tar (compressed if its name ends in .gz) that begins with `manifest.json`: the
addresses of its stages and the digest of every file in it.
"""

from __future__ import annotations

import io
import json
import shutil
import tarfile
import uuid
import zlib
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from pyarrow.fs import FileType

from dmfc.engine.digest import RECORD, damage, folder_digests
from dmfc.engine.ledger import Ledger
from dmfc.engine.store import identity_key, verify
from dmfc.errors import DmfcError, first_line
from dmfc.files.storage import located

MANIFEST = "manifest.json"
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
        raise DmfcError(f"'{place}' is there already: remove it, or give another name")
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
        raise DmfcError("nothing to export: no stage of that is finished")
    if archive.exists():
        raise DmfcError(f"'{archive}' is there already: remove it, or give another name")
    for address, wrong in verify(ledger, stages):
        if wrong:
            raise DmfcError(f"{address} cannot be exported: {wrong[0]} (dmfc store verify)")
    folders = [f"stages/{address}" for address in stages]
    folders += [f"sweeps/{sweep_id}" for sweep_id in sweep_ids]
    digests = {name: _digests(ledger.store / name) for name in folders}
    manifest = json.dumps({"version": VERSION, "stages": stages, "folders": digests}, indent=1)
    temporary = archive.with_name(f".{archive.name}.{uuid.uuid4().hex[:8]}")
    try:
        with tarfile.open(temporary, "w:gz" if archive.suffix == ".gz" else "w") as tar:
            head = tarfile.TarInfo(MANIFEST)
            head.size = len(manifest.encode())
            tar.addfile(head, io.BytesIO(manifest.encode()))
            for folder, files in digests.items():
                for name in files:
                    tar.add(ledger.store / folder / name, f"{folder}/{name}")
        temporary.replace(archive)
    except OSError as error:
        raise DmfcError(f"'{archive}' was not written: {error}") from error
    finally:
        temporary.unlink(missing_ok=True)
    return len(stages)


def take_in(ledger: Ledger, archive: Path) -> Imported:
    """Add an archive's stages and sweeps to a store. All is checked before anything is added.

    A stage that is here already stays as it is, and a sweep's own files too.
    Raises DmfcError where the archive is damaged, unsafe (links, absolute paths, '..'), or of
    something else.
    """
    ledger.prepare()
    staging = ledger.store / "work" / f"import-{uuid.uuid4().hex[:8]}"
    staging.mkdir()
    try:
        with tarfile.open(archive) as tar:
            # The filter refuses links out of the folder, absolute paths, '..' and devices.
            tar.extractall(staging, filter="data")
        stages, sweeps = _check(staging, archive)
        added: list[str] = []
        known: list[str] = []
        for address in stages:
            (added if _adopt(ledger, address, staging) else known).append(address)
        for name in sweeps:
            target = ledger.store / "sweeps" / name
            if not target.exists():
                (staging / "sweeps" / name).rename(target)
        return Imported(added, known, sweeps)
    except tarfile.ReadError as error:
        raise DmfcError(f"'{archive}' is no tar archive, or a damaged one") from error
    except (OSError, tarfile.TarError, EOFError, zlib.error) as error:
        raise DmfcError(f"'{archive}' was not taken in: {error}") from error
    finally:
        shutil.rmtree(staging, ignore_errors=True)


def _check(staging: Path, archive: Path) -> tuple[list[str], list[str]]:
    """Addresses of the stages and ids of the sweeps, after comparing every file and key."""
    try:
        manifest = json.loads((staging / MANIFEST).read_text())
        stages, folders = list(manifest["stages"]), dict(manifest["folders"])
        version = manifest["version"]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise DmfcError(f"'{archive}' is no archive of stages: no manifest ({error})") from error
    if version != VERSION:
        raise DmfcError(f"'{archive}' has version {version}; this dmfc reads {VERSION}")
    for folder, digests in folders.items():
        parts = Path(folder).parts
        if not parts or len(parts) != {"stages": 3, "sweeps": 2}.get(parts[0]) or ".." in parts:
            raise DmfcError(f"'{archive}': unexpected folder '{folder}'")
        recorded = dict(digests)
        own = recorded.pop(RECORD, None)
        wrong = list(damage(staging / folder, recorded))
        if own != _digests(staging / folder).get(RECORD):
            wrong.append(f"{RECORD} has changed")
        if wrong:
            raise DmfcError(f"'{archive}' is damaged: {folder}: {wrong[0]}")
    if {f"stages/{address}" for address in stages} != {f for f in folders if f[:7] == "stages/"}:
        raise DmfcError(f"'{archive}': its manifest lists other stages than it has digests of")
    for address in stages:
        record = json.loads((staging / "stages" / address / RECORD).read_text())
        if f"{record['kind']}/{identity_key(record)}" != address:
            raise DmfcError(f"'{archive}': the record of {address} is of another key")
    return stages, [name.partition("/")[2] for name in folders if name.startswith("sweeps/")]


def _adopt(ledger: Ledger, address: str, staging: Path) -> bool:
    """Move one checked stage in unless it is there; whether it was moved."""
    with ledger.lock(address):
        if ledger.finished(address):
            return False
        final = ledger.folder(address)
        final.parent.mkdir(parents=True, exist_ok=True)
        shutil.rmtree(final, ignore_errors=True)  # it has no record: nothing finished
        (staging / "stages" / address).rename(final)
        return True


def _digests(folder: Path) -> dict[str, str]:
    """Digests of all files of a folder, the record too."""
    from dmfc.files.digest import file_digest

    own = {RECORD: file_digest(folder / RECORD)} if (folder / RECORD).is_file() else {}
    return own | folder_digests(folder)
