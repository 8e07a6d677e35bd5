"""The running stages of a sweep, for any process that sees the store."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from dmfc.engine.context import read_attempt, read_progress
from dmfc.engine.ledger import Ledger
from dmfc.files.locks import is_held


@dataclass(frozen=True)
class Running:
    """A stage that a living process works on."""

    address: str
    name: str
    host: str
    seconds: float
    fraction: float
    message: str


def counts(ledger: Ledger, stages: Iterable[str]) -> dict[str, tuple[int, int]]:
    """Finished and all stages by kind, of those at the given addresses."""
    total, done = Counter[str](), Counter[str]()
    for address in stages:
        kind = address.partition("/")[0]
        total[kind] += 1
        done[kind] += ledger.finished(address)
    return {kind: (done[kind], total[kind]) for kind in total}


def running(ledger: Ledger, stages: Mapping[str, str]) -> Iterator[Running]:
    """Those of the stages (address -> name) that are being run: begun, not finished, locked."""
    for address, name in stages.items():
        begun = read_attempt(ledger.work(address))
        if not begun or ledger.finished(address):
            continue
        if is_held(Path(ledger.lock(address).lock_file)):  # else whoever began it is dead
            fraction, message = read_progress(ledger.work(address))
            seconds = time.time() - begun["started"]
            yield Running(address, name, begun["host"], seconds, fraction, message)
