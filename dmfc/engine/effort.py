"""How long stages will take: from measured times of stages like them, else by a stated guess."""

from __future__ import annotations

import heapq
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from dmfc.engine.kinds import Effort, Registry, kind_of
from dmfc.engine.ledger import Ledger
from dmfc.engine.stage import Stage, plain


@dataclass(frozen=True)
class Estimate:
    """Time of a stage on one CPU, and whether stages like it were measured in the store."""

    seconds: float
    measured: bool


@dataclass
class Times:
    """Seconds per unit of work, by kind of stage and by what makes stages of it alike."""

    ledger: Ledger
    kinds: Registry
    _known: dict[tuple[str, str], tuple[float, float]] = field(default_factory=dict)
    """Seconds and units of the finished stages."""
    _efforts: dict[str, Effort] = field(default_factory=dict)
    _configs: dict[str, Mapping[str, Any]] = field(default_factory=dict)

    def learn(self, kinds: Iterable[str]) -> None:
        """Take in the finished stages of those kinds."""
        for kind in dict.fromkeys(kinds):
            wanted = kind_of(kind, self.kinds)
            for record in self.ledger.records(kind):
                if record.get("stage_version") != wanted.version:
                    continue  # of other code, with other settings
                given = record["inputs"].get(wanted.sized_by, [])
                addresses = given if isinstance(given, list) else [given]
                if all(self.ledger.finished(address) for address in addresses):
                    sizes = [self._config(address) for address in addresses]
                    effort = wanted.effort(record["config"], sizes)
                    self._count(kind, effort, float(record["seconds"]))

    def add(self, stage: Stage, seconds: float) -> None:
        """Take in a stage that was just run."""
        self._count(stage.kind, self._effort(stage), seconds)

    def estimate(self, stage: Stage) -> Estimate:
        """From stages like it; from none, the guess of its kind."""
        effort = self._effort(stage)
        seconds, units = self._known.get((stage.kind, effort.like), (0.0, 0.0))
        if units:
            return Estimate(effort.units * seconds / units, True)
        return Estimate(effort.units * effort.guess, False)

    def _count(self, kind: str, effort: Effort, seconds: float) -> None:
        before = self._known.get((kind, effort.like), (0.0, 0.0))
        self._known[kind, effort.like] = (before[0] + seconds, before[1] + effort.units)

    def _effort(self, stage: Stage) -> Effort:
        if stage.address not in self._efforts:
            measure = kind_of(stage.kind, self.kinds).effort
            self._efforts[stage.address] = measure(plain(stage.config), self._sizes(stage))
        return self._efforts[stage.address]

    def _sizes(self, stage: Stage) -> list[Mapping[str, Any]]:
        """Settings of the inputs that the work of a stage follows from."""
        given = stage.inputs.get(kind_of(stage.kind, self.kinds).sized_by, ())
        stages = given if isinstance(given, tuple) else (given,)
        for one in stages:
            if one.address not in self._configs:
                self._configs[one.address] = plain(one.config)
        return [self._configs[one.address] for one in stages]

    def _config(self, address: str) -> Mapping[str, Any]:
        if address not in self._configs:
            self._configs[address] = self.ledger.record(address)["config"]
        return self._configs[address]


@dataclass(frozen=True)
class Cost:
    """What stages will take."""

    wall: float
    """Seconds on the CPUs that there are: stages wait for their inputs and for a free CPU."""
    by_kind: Mapping[str, float]
    """Seconds on one CPU."""
    guessed: tuple[str, ...]
    """Kinds of which stages were guessed, since none like them was measured here."""

    @property
    def cpu(self) -> float:
        """Seconds on one CPU."""
        return sum(self.by_kind.values())


def cost(
    stages: Sequence[Stage], times: Times, cpus: int, begun: Mapping[str, float] | None = None
) -> Cost:
    """What `stages` will take on `cpus` CPUs, one each, started in the order of the engine.

    `begun`: seconds that are left of those that are at work, by address.
    """
    seconds: dict[str, float] = {}
    by_kind: dict[str, float] = {}
    guessed: dict[str, None] = {}
    for stage in stages:
        found = times.estimate(stage)
        if begun is not None and stage.address in begun:
            seconds[stage.address] = begun[stage.address]
        else:
            seconds[stage.address] = found.seconds
            if not found.measured:
                guessed[stage.kind] = None
        by_kind[stage.kind] = by_kind.get(stage.kind, 0.0) + seconds[stage.address]
    return Cost(_makespan(stages, seconds, cpus, set(begun or ())), by_kind, tuple(guessed))


def ranks(
    needed: Mapping[str, Stage], users: Mapping[str, list[str]]
) -> dict[str, tuple[int, int]]:
    """What the longest chain of users hangs on comes first; ties keep the order of the graph."""
    height: dict[str, int] = {}
    for address in reversed(list(needed)):
        height[address] = 1 + max((height[user] for user in users[address]), default=0)
    return {address: (-height[address], place) for place, address in enumerate(needed)}


def _makespan(
    stages: Sequence[Stage], seconds: Mapping[str, float], cpus: int, begun: set[str]
) -> float:
    """When the last stage ends, of stages in an order in which inputs come first."""
    needed = {stage.address: stage for stage in stages}
    waiting = {
        address: sum(parent.address in needed for parent in stage.parents)
        for address, stage in needed.items()
    }
    users: dict[str, list[str]] = {address: [] for address in needed}
    for address, stage in needed.items():
        for parent in stage.parents:
            if parent.address in users:
                users[parent.address].append(address)
    order = ranks(needed, users)
    # What has begun holds its CPU.
    ready = [(a not in begun, order[a], a) for a, count in waiting.items() if not count]
    heapq.heapify(ready)
    running: list[tuple[float, str]] = []
    now = 0.0
    while ready or running:
        while ready and len(running) < max(1, cpus):
            _, _, address = heapq.heappop(ready)
            heapq.heappush(running, (now + seconds[address], address))
        now, ended = heapq.heappop(running)
        for user in users[ended]:
            waiting[user] -= 1
            if not waiting[user]:
                heapq.heappush(ready, (True, order[user], user))
    return now
