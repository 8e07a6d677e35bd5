"""The ledger: finished stages as folders `<store>/stages/<kind>/<key>/`, each with a `stage.json`.

A stage is finished if and only if its `stage.json` is there and whole. It is written last, in a
temporary folder that is brought onto the disk and then renamed, so a stage is never half there,
whatever dies. It holds the digests of the other files, which are compared before a stage is used.
A stage whose function cannot succeed (an object that cannot be repaired) may be finished too, with
a `failure.json` in place of its outputs: users read it and go on without.
"""

from __future__ import annotations

import json
import re
import shutil
import uuid
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from filelock import FileLock, Timeout

from dmfc.config.setting import KEYS_VERSION
from dmfc.engine.record import (
    FAILURE,
    RECORD,
    RECORD_VERSION,
    failure_in,
    is_finished,
    read_record,
    verified,
)
from dmfc.errors import DmfcError, first_line
from dmfc.files.atomic import move, sync, write_json
from dmfc.files.digest import folder_digests
from dmfc.files.sealed import write_sealed

VERSION = "version.json"
"""The file of a store that says which version of keys its stages have; none: version 1."""


class Ledger:
    """Finished stages of one store. Cheap to make; holds nothing but the path."""

    def __init__(self, store: Path) -> None:
        self.store = _folder_of(store)

    def prepare(self) -> None:
        """Make the store's folders.

        Raises DmfcError where the store cannot be written, or is of another version of dmfc.
        """
        self.check_version()
        try:
            for name in ("stages", "work", "locks", "sweeps"):
                (self.store / name).mkdir(parents=True, exist_ok=True)
            probe = self.store / "work" / f".probe-{uuid.uuid4().hex}"
            probe.touch()
            probe.unlink()
            if not (self.store / VERSION).is_file():
                write_json(self.store / VERSION, {"keys": KEYS_VERSION})
        except OSError as error:
            raise DmfcError(
                f"cannot write to the store '{self.store}': {error.strerror} (see --store)"
            ) from error

    def check_version(self) -> None:
        """Raises DmfcError where the stages have keys of another version: none would be found."""
        path = self.store / VERSION
        if path.is_file():
            try:
                version = json.loads(path.read_text())["keys"]
            except (OSError, ValueError, KeyError, TypeError) as error:
                raise DmfcError(
                    f"'{path}' cannot be read ({first_line(error)}): delete it if this version of "
                    "dmfc made the store"
                ) from error
        else:
            version = 1 if next(self.addresses(), None) else KEYS_VERSION
        if version != KEYS_VERSION:
            raise DmfcError(
                f"the store '{self.store}' was made by another version of dmfc (keys {version}, "
                f"this one has {KEYS_VERSION}), which cannot use its stages: give another --store, "
                "or delete it; `dmfc tables` still reads it"
            )

    def folder(self, address: str) -> Path:
        """Where the finished stage at `address` ('kind/key') is, or will be."""
        return self.store / "stages" / address

    def verified(self, address: str) -> Path:
        """The folder of a finished stage whose files are what they were when it was finished.

        They are compared with their digests once per process. Use this to read outputs. Raises
        DamagedError naming a file that differs, and what to do about it.
        """
        return verified(self.folder(address))

    def work(self, address: str) -> Path:
        """The folder that persists over the attempts of one stage."""
        return self.store / "work" / address.replace("/", "-")

    def finished(self, address: str) -> bool:
        """Whether the stage is there: a record that is damaged does not count."""
        return is_finished(self.folder(address))

    def record(self, address: str) -> dict[str, Any]:
        """What `stage.json` of a finished stage says."""
        return read_record(self.folder(address))

    def failure(self, address: str) -> str | None:
        """Why a finished stage has a failure in place of its outputs; None if it has outputs.

        Raises DamagedError where that is not what was written.
        """
        folder = self.folder(address)
        return failure_in(verified(folder)) if (folder / FAILURE).is_file() else None

    def addresses(self, kind: str = "*") -> Iterator[str]:
        """The finished stages, of one kind or of all."""
        return (address for address in self.present(kind) if self.finished(address))

    def present(self, kind: str = "*") -> Iterator[str]:
        """As `addresses`, with those whose record is damaged or gone."""
        for path in sorted((self.store / "stages").glob(f"{kind}/*")):
            if path.is_dir() and not path.name.startswith("."):
                yield f"{path.parent.name}/{path.name}"

    def records(self, kind: str) -> Iterator[dict[str, Any]]:
        """The records of all finished stages of one kind."""
        for address in self.addresses(kind):
            yield self.record(address)

    @contextmanager
    def claim(
        self, address: str, waits: Callable[[], None] = lambda: None
    ) -> Iterator[Path | None]:
        """Hold the stage's lock: gives an empty folder to fill, or None if the stage is finished.

        Blocks while another process holds it, after a call of `waits`; a lock is freed by its
        holder's death.
        """
        lock = self.lock(address)
        try:
            lock.acquire(timeout=0)
        except Timeout:
            waits()
            lock.acquire()
        try:
            if self.finished(address):
                yield None
                return
            partial = self._partial(address)
            shutil.rmtree(partial, ignore_errors=True)
            partial.mkdir(parents=True)
            self.work(address).mkdir(parents=True, exist_ok=True)
            try:
                yield partial
            finally:
                shutil.rmtree(partial, ignore_errors=True)
        finally:
            lock.release()

    def commit(self, address: str, record: dict[str, Any]) -> None:
        """Turn the claimed, filled folder into the finished stage. Call inside `claim`."""
        partial = self._partial(address)
        content = {**record, "files": folder_digests(partial)}
        write_sealed(partial / RECORD, RECORD_VERSION, content)
        self.adopt(address, partial)
        shutil.rmtree(self.work(address), ignore_errors=True)

    def adopt(self, address: str, folder: Path) -> None:
        """Make a folder with its record the finished stage. Hold its lock.

        What is there already has no whole record, and is set aside.
        """
        final = self.folder(address)
        if final.exists():
            self.set_aside(address)
        final.parent.mkdir(parents=True, exist_ok=True)
        move(folder, final)
        sync(final.parent.parent)

    def set_aside(self, address: str) -> Path:
        """Move a stage's folder out of the ledger, so that it is made again; where it is then.

        Hold its lock.
        """
        aside = self.store / "damaged" / f"{address.replace('/', '-')}-{uuid.uuid4().hex[:8]}"
        aside.parent.mkdir(parents=True, exist_ok=True)
        move(self.folder(address), aside)
        return aside

    def commit_failure(self, address: str, record: dict[str, Any], reason: str) -> None:
        """Finish the claimed stage with a failure in place of outputs. Call inside `claim`."""
        partial = self._partial(address)
        shutil.rmtree(partial)
        partial.mkdir()
        write_json(partial / FAILURE, {"reason": reason})
        self.commit(address, record)

    def lock(self, address: str) -> FileLock:
        """The lock of one stage."""
        path = self.store / "locks" / f"{address.replace('/', '-')}.lock"
        path.parent.mkdir(parents=True, exist_ok=True)
        return FileLock(path)

    def remove(self, address: str) -> None:
        """Forget a finished stage, whole: it is renamed first. Hold its lock."""
        doomed = self._partial(address)
        shutil.rmtree(doomed, ignore_errors=True)
        self.folder(address).rename(doomed)
        shutil.rmtree(doomed)

    def _partial(self, address: str) -> Path:
        kind, key = address.split("/")
        return self.store / "stages" / kind / f".partial-{key}"


def _folder_of(store: Path) -> Path:
    """The store as an absolute path. Raises DmfcError on a URL of anything but files."""
    text = str(store)  # as a path a URL has one slash: 's3:/bucket'
    scheme = re.match(r"([A-Za-z][A-Za-z0-9+.-]+):/+", text)
    if scheme is None:
        return Path(store).expanduser().absolute()
    if scheme[1].lower() == "file":
        return Path("/" + text[scheme.end() :])
    raise DmfcError(
        f"a store at {scheme[1]}:// cannot be: stages are claimed by file locks and finished by a "
        "rename, which object stores lack; give --store a folder that all machines see (`dmfc "
        "store export` and `import` take URLs)"
    )
