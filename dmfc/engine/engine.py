"""Runs a graph of stages: each one once, as soon as its inputs are finished."""

from __future__ import annotations

import heapq
import time
import uuid
from collections.abc import Iterable, Sequence
from typing import Protocol

from dmfc.config.schema import Config
from dmfc.config.sweep import StageLimits
from dmfc.engine.context import read_attempt
from dmfc.engine.effort import ranks
from dmfc.engine.kinds import Registry, kind_of
from dmfc.engine.ledger import Ledger
from dmfc.engine.lookout import Lookout
from dmfc.engine.pools import LocalPool, Pool, RayPool
from dmfc.engine.provenance import git_commit
from dmfc.engine.retries import Retries
from dmfc.engine.stage import Stage, closure
from dmfc.engine.worker import Job, Outcome, crash_in, give_up
from dmfc.files.sealed import DamagedError

POLL_SECONDS = 0.5
SCALING_QUEUE = 64
"""Stages submitted at once to a cluster that starts nodes for what waits."""


class Watcher(Protocol):
    """Told what happens; shows it to a person."""

    def begin(self, stages: Sequence[Stage], cpus: int) -> None:
        """The stages that will be run."""

    def finished(self, stage: Stage, outcome: Outcome) -> None:
        """One stage came to its end."""

    def note(self, text: str) -> None:
        """Something that a person should know of: what is waited for, a node that is left out."""

    def tick(self, running: Sequence[Job]) -> None:
        """Called about twice a second with the jobs submitted."""

    def end(self) -> None:
        """Nothing more will come."""


Outcomes = dict[str, Outcome]
"""Outcome of each stage by its address."""


def run_stages(
    targets: Iterable[Stage],
    ledger: Ledger,
    config: Config,
    kinds: Registry,
    *,
    watcher: Watcher | None = None,
    local: bool = False,
) -> Outcomes:
    """Make every target and what it needs that is not in the ledger yet.

    Never raises for a stage: read the outcomes. A failed stage blocks its dependants alone. Ctrl-C
    ends cleanly with what is unfinished as 'interrupted'. Nothing is started if all is there.
    """
    targets = list(targets)
    needed = unfinished(targets, ledger)
    outcomes: Outcomes = {
        stage.address: _known(stage, ledger, kinds)
        for stage in closure(targets)
        if stage.address not in needed and ledger.finished(stage.address)
    }
    if not needed:
        return outcomes
    ledger.prepare()
    # A time limit is kept by ending the process of a stage, which must not be this one; and GPUs
    # are granted by Ray.
    limits = [_limits(stage, config, kinds) for stage in needed.values()]
    local = local and not any(limit.seconds or limit.gpus for limit in limits)
    note = watcher.note if watcher else lambda text: None
    pool: Pool = LocalPool(config.run, note) if local else RayPool(config.run)
    return _Drive(needed, ledger, config, pool, kinds, watcher, outcomes).run()


def unfinished(targets: Iterable[Stage], ledger: Ledger) -> dict[str, Stage]:
    """Stages that must run, inputs before users. What made a finished stage is not needed."""
    found: dict[str, Stage] = {}

    def visit(stage: Stage) -> None:
        if stage.address in found or ledger.finished(stage.address):
            return
        for parent in stage.parents:
            visit(parent)
        found[stage.address] = stage

    for target in targets:
        visit(target)
    return found


def _known(stage: Stage, ledger: Ledger, kinds: Registry) -> Outcome:
    """The outcome of a stage that the ledger holds."""
    try:
        failure = ledger.failure(stage.address) if kind_of(stage.kind, kinds).may_fail else None
    except DamagedError as error:
        return Outcome("failed", str(error))
    return Outcome("done") if failure is None else Outcome("failed", failure, kept=True)


def _limits(stage: Stage, config: Config, kinds: Registry) -> StageLimits:
    return kind_of(stage.kind, kinds).limits(config)


class _Drive:
    """The state of one run over the graph."""

    def __init__(
        self,
        needed: dict[str, Stage],
        ledger: Ledger,
        config: Config,
        pool: Pool,
        kinds: Registry,
        watcher: Watcher | None,
        outcomes: Outcomes,
    ) -> None:
        self.needed, self.ledger, self.config = needed, ledger, config
        self.pool, self.kinds, self.watcher, self.outcomes = pool, kinds, watcher, outcomes
        self.waiting_for = {
            address: {parent.address for parent in stage.parents if parent.address in needed}
            for address, stage in needed.items()
        }
        self.users: dict[str, list[str]] = {address: [] for address in needed}
        for address, parents in self.waiting_for.items():
            for parent in parents:
                self.users[parent].append(address)
        self.rank = ranks(needed, self.users)
        self.ready = [self._entry(a) for a, parents in self.waiting_for.items() if not parents]
        heapq.heapify(self.ready)
        self.running: dict[str, Job] = {}
        self.lookout = Lookout(ledger, config.run.scales_up, self._note)
        self.retries = Retries(pool, self.lookout, self._note)
        self.sign = f"locks/driver-{uuid.uuid4().hex}.sign"
        self.commit = git_commit()

    def run(self) -> Outcomes:
        if self.watcher:
            self.watcher.begin(list(self.needed.values()), self.pool.cpus)
        abandon = True
        (self.ledger.store / self.sign).touch()
        try:
            while self.ready or self.running:
                self._submit()
                for job, outcome in self.pool.wait(POLL_SECONDS):
                    self._settle(job, outcome)
                self._stop_overdue()
                self._settle_what_ray_does_not()
                if self.watcher:
                    self.watcher.tick(list(self.running.values()))
            abandon = False
        except KeyboardInterrupt:
            for address in self.needed:
                self.outcomes.setdefault(address, Outcome("interrupted", "stopped by the user"))
        finally:
            if self.watcher:
                self.watcher.end()
            self.pool.close(abandon)
            (self.ledger.store / self.sign).unlink(missing_ok=True)
        return self.outcomes

    def _note(self, text: str) -> None:
        if self.watcher:
            self.watcher.note(text)

    def _entry(self, address: str) -> tuple[tuple[int, int], str]:
        return self.rank[address], address

    def _submit(self) -> None:
        # A short queue: what is submitted can no longer be overtaken by something more urgent.
        most = max(2 * self.pool.cpus, SCALING_QUEUE if self.config.run.scales_up else 0)
        while self.ready and len(self.running) < most:
            _, address = heapq.heappop(self.ready)
            job = self._job(self.needed[address])
            self.running[address] = job
            self.pool.submit(job)

    def _settle(self, job: Job, outcome: Outcome) -> None:
        del self.running[job.address]
        limits = _limits(self.needed[job.address], self.config, self.kinds)
        if self.retries.again(job, outcome, limits.retries):
            heapq.heappush(self.ready, self._entry(job.address))
            return
        outcome = self._final(job, outcome)
        self._finish(job.address, outcome)
        for user in self.users[job.address]:
            if outcome.ok or outcome.kept:
                self.waiting_for[user].discard(job.address)
                if not self.waiting_for[user] and user not in self.outcomes:
                    heapq.heappush(self.ready, self._entry(user))
            else:
                self._block(user, f"needs {self.needed[job.address].name}: {outcome.reason}")

    def _final(self, job: Job, outcome: Outcome) -> Outcome:
        """The outcome of a stage that is not tried again."""
        if outcome.status not in ("died", "machine", "unmet"):
            return outcome
        reason = self.retries.reason(job, outcome)
        crash = crash_in(self.ledger.work(job.address)) if outcome.status == "died" else ""
        # A process that was killed, or died with its machine, says nothing about the stage.
        return self._failed(job, f"{crash}: {reason}") if crash else Outcome("failed", reason)

    def _settle_what_ray_does_not(self) -> None:
        """Settle the jobs that are over, or never begin, though Ray does not say so."""
        if isinstance(self.pool, LocalPool):
            return
        for job, outcome in self.lookout.look(list(self.running.values()), self.pool.nodes()):
            self.pool.cancel(job)
            self._settle(job, outcome)

    def _stop_overdue(self) -> None:
        """End the stages that have taken longer than their limit."""
        for job in [job for job in self.running.values() if job.seconds]:
            begun = read_attempt(self.ledger.work(job.address))
            if begun.get("attempt") == job.attempt and time.time() - begun["started"] > job.seconds:
                self.pool.cancel(job)
                reason = f"took longer than {job.seconds:g} s (run.{job.kind}.seconds)"
                self._settle(job, self._failed(job, reason))

    def _failed(self, job: Job, reason: str) -> Outcome:
        outcome = Outcome("failed", reason)
        return give_up(job, self.ledger, outcome) if job.may_fail else outcome

    def _block(self, address: str, reason: str) -> None:
        """Mark the stage and all that needs it; the reason stays that of the first cause."""
        stack = [address]
        while stack:
            blocked = stack.pop()
            if blocked not in self.outcomes:
                self._finish(blocked, Outcome("blocked", reason))
                stack.extend(self.users[blocked])

    def _finish(self, address: str, outcome: Outcome) -> None:
        self.outcomes[address] = outcome
        if self.watcher:
            self.watcher.finished(self.needed[address], outcome)

    def _job(self, stage: Stage) -> Job:
        kind = kind_of(stage.kind, self.kinds)
        limits = kind.limits(self.config)
        largest = int(max((node.cpus for node in self.pool.nodes()), default=self.pool.cpus))
        cpus = limits.cpus if self.config.run.scales_up else min(limits.cpus, max(1, largest))
        job = Job(
            store=str(self.ledger.store),
            kind=stage.kind,
            name=stage.name,
            key=stage.key,
            version=stage.version,
            entry=kind.entry,
            config=dict(stage.config),
            input_keys=stage.input_keys,
            cpus=cpus,
            gpus=limits.gpus,
            memory_gb=limits.memory_gb,
            seconds=limits.seconds,
            may_fail=kind.may_fail,
            system_seconds=self.config.run.system_seconds,
            commit=self.commit,
            hints=dict(stage.hints),
            sign=self.sign,
        )
        return self.retries.placed(job)
