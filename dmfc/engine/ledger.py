"""The ledger: finished stages as folders `<store>/stages/<kind>/<key>/`, each with a `stage.json`.

A stage is finished if and only if its `stage.json` is there. It is written last, in a temporary
folder that is then renamed, so a stage is never half there, whatever dies. It holds the digests of
the other files. A stage whose function cannot succeed (an object that cannot be repaired) may be
finished too, with a `failure.json` in place of its outputs: users read it and go on without.
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

from dmfc.engine.digest import RECORD, folder_digests
from dmfc.errors import DmfcError
from dmfc.files.atomic import write_json

FAILURE = "failure.json"
RECORD_VERSION = 2
"""1 lacked `files`, the digests."""


class Ledger:
    """Finished stages of one store. Cheap to make; holds nothing but the path."""

    def __init__(self, store: Path) -> None:
        self.store = _folder_of(store)

    def prepare(self) -> None:
        """Make the store's folders. Raises DmfcError where the store cannot be written."""
        try:
            for name in ("stages", "work", "locks", "sweeps"):
                (self.store / name).mkdir(parents=True, exist_ok=True)
            probe = self.store / "work" / f".probe-{uuid.uuid4().hex}"
            probe.touch()
            probe.unlink()
        except OSError as error:
            raise DmfcError(
                f"cannot write to the store '{self.store}': {error.strerror} (see --store)"
            ) from error

    def folder(self, address: str) -> Path:
        """The folder of the finished stage at `address` ('kind/key')."""
        return self.store / "stages" / address

    def work(self, address: str) -> Path:
        """The folder that persists over the attempts of one stage."""
        return self.store / "work" / address.replace("/", "-")

    def finished(self, address: str) -> bool:
        """Whether the stage is there."""
        return (self.folder(address) / RECORD).is_file()

    def record(self, address: str) -> dict[str, Any]:
        """What `stage.json` of a finished stage says."""
        return read_record(self.folder(address))

    def failure(self, address: str) -> str | None:
        """Why a finished stage has a failure in place of its outputs; None if it has outputs."""
        return failure_in(self.folder(address))

    def addresses(self, kind: str = "*") -> Iterator[str]:
        """The finished stages, of one kind or of all."""
        for path in sorted((self.store / "stages").glob(f"{kind}/*/{RECORD}")):
            yield f"{path.parent.parent.name}/{path.parent.name}"

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
        partial, final = self._partial(address), self.folder(address)
        files = folder_digests(partial)
        write_json(partial / RECORD, {"version": RECORD_VERSION, **record, "files": files})
        if final.exists():  # left by something that is no ledger: it has no record
            shutil.rmtree(final)
        partial.rename(final)
        shutil.rmtree(self.work(address), ignore_errors=True)

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


def read_record(folder: Path) -> dict[str, Any]:
    """What the `stage.json` in a finished stage's folder says."""
    path = folder / RECORD
    try:
        return json.loads(path.read_text())
    except (OSError, json.JSONDecodeError) as error:
        raise DmfcError(f"the record '{path}' cannot be read: {error}") from error


def failure_in(folder: Path) -> str | None:
    """The reason in a finished stage's folder; None if it has outputs."""
    path = folder / FAILURE
    return str(json.loads(path.read_text())["reason"]) if path.is_file() else None
