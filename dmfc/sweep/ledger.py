"""The ledger: finished stages as folders `<store>/stages/<kind>/<key>/`, each with a `stage.json`.

A stage is finished if and only if its `stage.json` is there. It is written last, in a temporary
folder that is then renamed, so a stage is never half there, whatever dies.
"""

from __future__ import annotations

import json
import shutil
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from filelock import FileLock

from dmfc.errors import DmfcError
from dmfc.sweep.context import write_json

RECORD = "stage.json"
RECORD_VERSION = 1


class Ledger:
    """Finished stages of one store. Cheap to make; holds nothing but the path."""

    def __init__(self, store: Path) -> None:
        self.store = Path(store).expanduser().absolute()

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
        path = self.folder(address) / RECORD
        try:
            return json.loads(path.read_text())
        except (OSError, json.JSONDecodeError) as error:
            raise DmfcError(f"the record '{path}' cannot be read: {error}") from error

    def records(self, kind: str) -> Iterator[dict[str, Any]]:
        """The records of all finished stages of one kind."""
        for path in sorted((self.store / "stages" / kind).glob(f"*/{RECORD}")):
            yield self.record(f"{kind}/{path.parent.name}")

    @contextmanager
    def claim(self, address: str) -> Iterator[Path | None]:
        """Hold the stage's lock: gives an empty folder to fill, or None if the stage is finished.

        Blocks while another process holds it; a lock is freed by its holder's death.
        """
        lock = self.store / "locks" / f"{address.replace('/', '-')}.lock"
        lock.parent.mkdir(parents=True, exist_ok=True)
        with FileLock(lock):
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

    def commit(self, address: str, record: dict[str, Any]) -> None:
        """Turn the claimed, filled folder into the finished stage. Call inside `claim`."""
        partial, final = self._partial(address), self.folder(address)
        write_json(partial / RECORD, {"version": RECORD_VERSION, **record})
        if final.exists():  # left by something that is no ledger: it has no record
            shutil.rmtree(final)
        partial.rename(final)
        shutil.rmtree(self.work(address), ignore_errors=True)

    def _partial(self, address: str) -> Path:
        kind, key = address.split("/")
        return self.store / "stages" / kind / f".partial-{key}"
