"""Which stages are tried again, how often, and on which nodes."""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Callable

from dmfc.engine.lookout import Lookout
from dmfc.engine.nodes import MACHINE_TRIES, NodeErrors
from dmfc.engine.pools import Pool
from dmfc.engine.worker import Job, Outcome


class Retries:
    """What the outcomes of one run say about its stages and nodes."""

    def __init__(self, pool: Pool, lookout: Lookout, note: Callable[[str], None]) -> None:
        self._pool, self._lookout, self._note = pool, lookout, note
        self._errors = NodeErrors()
        self._deaths: Counter[str] = Counter()
        """Of each stage."""

    def again(self, job: Job, outcome: Outcome, retries: int) -> bool:
        """Whether a stage is tried again after this outcome; `retries`: attempts after a death."""
        if outcome.status == "ran":
            self._errors.succeeded(outcome.node)
        if outcome.status == "died":
            self._deaths[job.address] += 1
            return self._deaths[job.address] <= retries
        if outcome.status == "machine" and outcome.node:
            return self._elsewhere(job, outcome)
        if outcome.status == "unmet":  # a node may be avoided that need not be
            return self.placed(job).avoid != job.avoid
        return outcome.status == "cut"

    def _elsewhere(self, job: Job, outcome: Outcome) -> bool:
        """After an error of the machine: whether there is another node for the stage."""
        nodes = self._pool.nodes()
        self._errors.add(job.address, outcome.node)
        if self._errors.leave_out(outcome.node, nodes):
            name = f"{outcome.host} ({outcome.node[:8]})"
            self._note(f"node {name} is left out of the rest of this run: {outcome.reason}")
        if len(self._errors.met(job.address)) < MACHINE_TRIES:
            fresh = self.placed(job)
            if any(node.meets(fresh) for node in nodes):
                return True
        self._errors.acquit(job.address)
        return False

    def reason(self, job: Job, outcome: Outcome) -> str:
        """Why a stage is not tried again."""
        if outcome.status == "died":
            return f"{outcome.reason}; {self._deaths[job.address]} attempts (run.retries)"
        others = len(self._errors.met(job.address)) - 1
        if outcome.status == "machine" and others >= 0:
            more = f" and {others} more" if others else ""
            return f"{outcome.reason} (on node {outcome.host}{more})"
        return outcome.reason

    def placed(self, job: Job) -> Job:
        """The job, kept from nodes where it cannot be done.

        Nodes that failed at other stages are avoided where others are left. A node where it died
        is not: who killed the process is not known, and the others may be busy for hours.
        """
        needed = self._errors.met(job.address) | self._lookout.cut_off
        wanted = needed | self._errors.left_out
        careful = dataclasses.replace(job, avoid=tuple(sorted(wanted)))
        if any(node.meets(careful) for node in self._pool.nodes()):
            return careful
        return dataclasses.replace(job, avoid=tuple(sorted(needed)))
