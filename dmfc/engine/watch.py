"""Shows progress while stages run: a live table in a terminal, plain lines elsewhere."""

from __future__ import annotations

import math
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from rich.console import Console, RenderableType
from rich.live import Live
from rich.table import Table
from rich.text import Text

from dmfc.engine.context import read_attempt, read_progress
from dmfc.engine.effort import Times, cost
from dmfc.engine.kinds import Registry
from dmfc.engine.ledger import Ledger
from dmfc.engine.stage import Stage
from dmfc.engine.worker import Job, Outcome

FRESH_SECONDS = 2.0
"""Time for which an estimate of the time left is shown before it is made again."""
TOLD = 0.05
"""Progress from which on the pace of a running stage says how long it still takes."""


@dataclass
class Tally:
    """Counts of the stages to run, by kind."""

    total: Counter[str] = field(default_factory=Counter)
    ended: Counter[str] = field(default_factory=Counter)
    failed: Counter[str] = field(default_factory=Counter)

    def add(self, stage: Stage, outcome: Outcome) -> None:
        """Count one stage that came to its end."""
        self.ended[stage.kind] += 1
        self.failed[stage.kind] += outcome.status in ("failed", "blocked")


class Progress:
    """Watches a run and shows it on `console` (see `dmfc.engine.engine.Watcher`)."""

    def __init__(self, ledger: Ledger, console: Console, kinds: Registry) -> None:
        self._ledger, self._console, self._kinds = ledger, console, kinds
        self._tally, self._times = Tally(), Times(ledger, kinds)
        self._open: dict[str, Stage] = {}
        self._left = ""
        self._cpu_left: Mapping[str, float] = {}
        self._looked = -math.inf
        self._live: Live | None = None
        self._cpus = 1
        self._running: Sequence[Job] = ()
        self._started = time.monotonic()

    def begin(self, stages: Sequence[Stage], cpus: int) -> None:
        self._cpus, self._started = cpus, time.monotonic()
        for stage in stages:
            self._tally.total[stage.kind] += 1
        self._open = {stage.address: stage for stage in stages}
        self._times.learn(self._tally.total)
        counts = ", ".join(f"{n} {kind}" for kind, n in self._tally.total.items())
        self._console.print(
            f"{sum(self._tally.total.values())} stages to run: {counts}; {self._time_left()}",
            soft_wrap=True,
        )
        if self._console.is_terminal:
            self._live = Live(console=self._console, refresh_per_second=4, transient=True)
            self._live.start()

    def finished(self, stage: Stage, outcome: Outcome) -> None:
        self._tally.add(stage, outcome)
        self._open.pop(stage.address, None)
        if outcome.status == "ran":
            self._times.add(stage, outcome.seconds)
        bad = not outcome.ok
        if self._live is None or bad:
            done, total = sum(self._tally.ended.values()), sum(self._tally.total.values())
            what = outcome.reason if bad else f"{outcome.seconds:.1f} s"
            line = f"[{done}/{total}] {stage.kind} {stage.name}: {outcome.status}, {what}"
            left = f"; {self._time_left()}" if self._live is None and done < total else ""
            self._console.print(Text(line + left, style="red" if bad else ""), soft_wrap=True)

    def note(self, text: str) -> None:
        self._console.print(Text(text, style="yellow"), soft_wrap=True)

    def tick(self, running: Sequence[Job]) -> None:
        self._running = running
        if self._live is not None:
            self._live.update(self._shown())

    def end(self) -> None:
        if self._live is not None:
            self._live.stop()
            self._live = None
        took = duration(time.monotonic() - self._started)
        failed = sum(self._tally.failed.values())
        tail = f", {failed} failed" if failed else ""
        self._console.print(f"{sum(self._tally.ended.values())} stages in {took}{tail}")

    def _time_left(self) -> str:
        """'about 3 min 05 s left', and which kinds that is guessed of."""
        if time.monotonic() - self._looked > FRESH_SECONDS:
            found = cost(list(self._open.values()), self._times, self._cpus, self._begun())
            self._cpu_left = found.by_kind
            guess = f", by a guess of {', '.join(found.guessed)}" if found.guessed else ""
            self._left = f"about {duration(found.wall)} left{guess}"
            self._looked = time.monotonic()
        return self._left

    def _begun(self) -> dict[str, float]:
        """Seconds that each running stage still takes, by address."""
        left = {}
        for job in self._running:
            work = self._ledger.work(job.address)
            told, stage = read_attempt(work), self._open.get(job.address)
            if not told or stage is None:  # it waits for a CPU, or has just ended
                continue
            spent, (fraction, _) = time.time() - told["started"], read_progress(work)
            rest = self._times.estimate(stage).seconds - spent
            left[job.address] = spent * (1 / fraction - 1) if fraction >= TOLD else max(0.0, rest)
        return left

    def _shown(self) -> RenderableType:
        return self._table()

    def _table(self) -> Table:
        table = Table(title=self._time_left(), title_justify="left", expand=False)
        for column in ("stage", "done", "failed", "CPU time left", "now"):
            table.add_column(column)
        for kind in self._tally.total:
            table.add_row(
                kind,
                f"{self._tally.ended[kind]}/{self._tally.total[kind]}",
                str(self._tally.failed[kind] or ""),
                duration(self._cpu_left[kind]) if kind in self._cpu_left else "",
                self._now(kind),
            )
        return table

    def _now(self, kind: str) -> str:
        lines = []
        for job in self._running:
            if job.kind == kind and self._ledger.work(job.address).is_dir():
                fraction, message = read_progress(self._ledger.work(job.address))
                lines.append(f"{job.name} {fraction:.0%} {message}".rstrip())
        return "\n".join(lines[:4])


def duration(seconds: float) -> str:
    """'42 s', '3 min 05 s' or '2 h 10 min'."""
    whole = round(seconds)
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60:02d} s"
    return f"{whole // 3600} h {whole % 3600 // 60:02d} min"
