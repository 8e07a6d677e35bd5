"""Finds out what Ray reports late or never, from the ledger and by asking the nodes."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from typing import Any

from filelock import Timeout

from dmfc.engine.context import read_attempt
from dmfc.engine.ledger import Ledger
from dmfc.engine.nodes import Node, Silence, unmet
from dmfc.engine.worker import Job, Outcome

LOOK_SECONDS = 2.0
UNMET_SECONDS = 8.0
"""Time in which a node may still join that gives what is asked for."""
ANSWER_SECONDS = 10.0
"""Time in which Ray may still bring the outcome of a stage that is over."""


class Lookout:
    """Looks at the submitted jobs every few seconds, and settles those that nothing comes of."""

    def __init__(self, ledger: Ledger, scales_up: bool, note: Callable[[str], None]) -> None:
        self._ledger, self._scales_up, self._note = ledger, scales_up, note
        self._silence = Silence()
        self._noted: set[str] = set()
        self._since: dict[tuple[str, str], float] = {}
        self._seen: set[tuple[str, str]] = set()
        self._next = 0.0
        self.cut_off: frozenset[str] = frozenset()
        """Nodes that do not answer, whatever Ray says."""

    def look(self, running: Sequence[Job], nodes: Sequence[Node]) -> Iterator[tuple[Job, Outcome]]:
        """Jobs that are over, and what became of them. Call often: mostly it does nothing."""
        if time.monotonic() < self._next or not running:
            return
        silent = self._silence.cut_off([node for node in nodes if node.port])
        newly = [node for node in silent if node.id not in self.cut_off]
        self.cut_off = frozenset(node.id for node in silent)
        for node in newly:
            self._note(
                f"node {node.host} ({node.address}) does not answer: nothing more runs there"
            )
        self._seen = set()
        for job in running:
            outcome = self._over(job, nodes, bool(newly))
            if outcome is not None:
                yield job, outcome
        self._since = {key: at for key, at in self._since.items() if key in self._seen}
        self._next = time.monotonic() + LOOK_SECONDS

    def _over(self, job: Job, nodes: Sequence[Node], newly_cut: bool) -> Outcome | None:
        """What became of a job; None while it waits or runs."""
        if self._ledger.finished(job.address):
            return Outcome("done") if self._lasts(job, "finished", ANSWER_SECONDS) else None
        holder = read_attempt(self._ledger.work(job.address))
        if holder.get("attempt") == job.attempt:
            return self._lost(job, holder, nodes)
        if newly_cut:  # it may wait for a worker over there
            return Outcome("cut", "submitted again, since a node was cut off")
        lack = unmet(job, nodes)
        if not lack:
            self._say_who_holds(job, holder)
        elif self._scales_up:
            self._once(f"{job.kind} {job.name} waits: {lack}")
        elif self._lasts(job, "unmet", UNMET_SECONDS):
            advice = "" if job.avoid else "; of a cluster that starts nodes, run.scales_up=true"
            return Outcome("unmet", lack + advice)
        return None

    def _lost(self, job: Job, holder: dict[str, Any], nodes: Sequence[Node]) -> Outcome | None:
        """'cut' if the node at work on a job is gone or does not answer."""
        node, host = str(holder.get("node", "")), str(holder["host"])
        if node in self.cut_off:
            return Outcome("cut", f"its node {host} does not answer", node=node, host=host)
        gone = node and node not in {other.id for other in nodes}
        if gone and self._lasts(job, "gone", ANSWER_SECONDS):
            return Outcome("cut", f"its node {host} is gone", node=node, host=host)
        return None

    def _say_who_holds(self, job: Job, holder: dict[str, Any]) -> None:
        """Say which process of another driver is at work on a stage that this one waits for."""
        if not holder:
            return
        try:
            self._ledger.lock(job.address).acquire(timeout=0).lock.release()
        except Timeout:
            self._once(held_by(job, holder))

    def _lasts(self, job: Job, what: str, seconds: float) -> bool:
        """Whether something has been so for some time, at every look."""
        key = (job.attempt, what)
        self._seen.add(key)
        return time.monotonic() - self._since.setdefault(key, time.monotonic()) >= seconds

    def _once(self, text: str) -> None:
        if text not in self._noted:
            self._noted.add(text)
            self._note(text)


def held_by(job: Job, holder: dict[str, Any]) -> str:
    """Who holds the lock of a job's stage, as `read_attempt` tells."""
    by = f"process {holder['pid']} on {holder['host']}" if holder else "another process"
    return f"{job.kind} {job.name}: {by} is at work on it; this call waits for that"
