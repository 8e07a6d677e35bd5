"""Lists the stages of a store, checks their digests, and removes unused ones."""

from __future__ import annotations

import shutil
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import datetime

from filelock import FileLock, Timeout

from dmfc.engine.ledger import Ledger
from dmfc.engine.record import RECORD, faults
from dmfc.errors import DmfcError, unknown_name
from dmfc.files.sealed import DamagedError

DAY = 86400.0


@dataclass(frozen=True)
class Entry:
    """One finished stage. `bytes` counts its files, `seconds` the time its function took."""

    address: str
    name: str
    bytes: int
    seconds: float
    made: str
    failure: str | None


def entries(ledger: Ledger, kind: str = "*") -> Iterator[Entry]:
    """The finished stages, of one kind or of all."""
    for address in ledger.addresses(kind):
        record = ledger.record(address)
        size = sum(p.stat().st_size for p in ledger.folder(address).rglob("*") if p.is_file())
        yield Entry(
            address,
            str(record["name"]),
            size,
            float(record["seconds"]),
            str(record["started"]),
            _failure(ledger, address),
        )


def known_kind(ledger: Ledger, kind: str) -> str:
    """`kind`, if the store has stages of it. Raises DmfcError naming the nearest."""
    kinds = {address.partition("/")[0] for address in ledger.present()}
    if kind not in kinds:
        raise unknown_name("kind of stage", kind, kinds)
    return kind


def find(ledger: Ledger, text: str) -> str:
    """The one address that begins with `text`, with its kind or without.

    Raises DmfcError if none does, or several do.
    """
    known = list(ledger.addresses())
    found = [a for a in known if a.startswith(text) or a.partition("/")[2].startswith(text)]
    if not found:
        raise unknown_name("stage", text, known)
    if len(found) > 1:
        raise DmfcError(f"'{text}' begins {len(found)} stages: {', '.join(found[:5])}")
    return found[0]


def verify(ledger: Ledger, addresses: Iterable[str]) -> Iterator[tuple[str, list[str]]]:
    """Each stage with what is wrong with it: files against digests, the key against its record.

    Goes on whatever it finds; a stage that cannot be read is wrong too.
    """
    for address in addresses:
        folder = ledger.folder(address)
        try:
            wrong = [" ".join(item) for item in faults(folder)]
            if "files" not in ledger.record(address):
                wrong = ["it was made before digests were kept"]
        except DmfcError as error:
            wrong = [str(error)]
        except OSError as error:
            wrong = [f"it cannot be read: {error.strerror or error}"]
        yield address, wrong


@dataclass(frozen=True)
class Repaired:
    """A damaged stage: what was wrong, and where it lies now; None: a living process holds it."""

    address: str
    wrong: list[str]
    aside: str | None


def repair(ledger: Ledger, addresses: Iterable[str]) -> Iterator[Repaired]:
    """Set damaged stages aside, so that whatever needs them makes them again."""
    for address in addresses:
        with _free(ledger.lock(address)) as free:
            wrong = _repairable(ledger, address)
            if wrong:
                aside = str(ledger.set_aside(address)) if free else None
                yield Repaired(address, wrong, aside)


def _repairable(ledger: Ledger, address: str) -> list[str]:
    """What is wrong with a stage that can be helped by making it again; empty if it is not there.

    Raises DmfcError where its files cannot be opened: that is the machine's trouble.
    """
    folder = ledger.folder(address)
    if not folder.is_dir():
        return []
    if not (folder / RECORD).is_file():
        return [f"{RECORD} is missing"]
    try:
        return [" ".join(item) for item in faults(folder)]
    except DamagedError as error:
        return [str(error)]
    except OSError as error:
        raise DmfcError(f"'{folder}' cannot be read: {error.strerror or error}") from error


def _failure(ledger: Ledger, address: str) -> str | None:
    try:
        return ledger.failure(address)
    except DamagedError as error:
        return str(error)


def referred(ledger: Ledger, addresses: Iterable[str]) -> set[str]:
    """The addresses of those stages and of their inputs, inputs of inputs too, if finished."""
    stack = list(addresses)
    found: set[str] = set()
    while stack:
        address = stack.pop()
        if address in found or not ledger.finished(address):
            continue
        found.add(address)
        for given in ledger.record(address)["inputs"].values():
            stack += given if isinstance(given, list) else [given]
    return found


def prunable(
    ledger: Ledger, keep: Iterable[str], older_than_days: float = 0.0, failed: bool = False
) -> list[Entry]:
    """Stages that no stage at the addresses `keep` needs, and that are older than so many days.

    With `failed`, all kept failures instead, so that the next call tries them again.
    """
    if failed:
        return [entry for entry in entries(ledger) if entry.failure is not None]
    needed, oldest = referred(ledger, keep), time.time() - older_than_days * DAY
    return [
        entry
        for entry in entries(ledger)
        if entry.address not in needed and datetime.fromisoformat(entry.made).timestamp() <= oldest
    ]


def prune(ledger: Ledger, doomed: Iterable[Entry]) -> list[Entry]:
    """Remove those stages, and what dead processes left; the ones removed.

    A stage that a running process holds stays.
    """
    gone = []
    for entry in doomed:
        with _free(ledger.lock(entry.address)) as free:
            if free and ledger.finished(entry.address):
                ledger.remove(entry.address)
                gone.append(entry)
    for partial in (ledger.store / "stages").glob("*/.partial-*"):
        address = f"{partial.parent.name}/{partial.name.removeprefix('.partial-')}"
        with _free(ledger.lock(address)) as free:
            if free:
                shutil.rmtree(partial, ignore_errors=True)
    return gone


@contextmanager
def _free(lock: FileLock) -> Iterator[bool]:
    """Holds a lock if nobody else does; gives whether it does."""
    try:
        lock.acquire(timeout=0)
    except Timeout:
        yield False
        return
    try:
        yield True
    finally:
        lock.release()
