"""Shows progress while stages run: a live table in a terminal, plain lines elsewhere."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field

from rich.console import Console, RenderableType
from rich.live import Live
from rich.table import Table
from rich.text import Text

from dmfc.engine.context import read_progress
from dmfc.engine.kinds import Registry
from dmfc.engine.ledger import Ledger
from dmfc.engine.stage import Stage
from dmfc.engine.worker import Job, Outcome

HISTORY = 50
"""Finished stages of a kind whose times are averaged for the time left."""


@dataclass
class Tally:
    """Counts and times of the stages to run, by kind, and the time left that follows from them."""

    total: Counter[str] = field(default_factory=Counter)
    ended: Counter[str] = field(default_factory=Counter)
    failed: Counter[str] = field(default_factory=Counter)
    seconds: dict[str, list[float]] = field(default_factory=dict)

    def add(self, stage: Stage, outcome: Outcome) -> None:
        """Count one stage that came to its end."""
        self.ended[stage.kind] += 1
        self.failed[stage.kind] += outcome.status in ("failed", "blocked")
        if outcome.status == "ran":
            self.seconds.setdefault(stage.kind, []).append(outcome.seconds)

    def mean_seconds(self, kind: str) -> float | None:
        """Mean time of the latest stages of a kind; None if none is known."""
        times = self.seconds.get(kind, [])[-HISTORY:]
        return sum(times) / len(times) if times else None

    def seconds_left(self, cpus: int) -> tuple[float, bool]:
        """Time left on so many CPUs, and whether every kind's time is known."""
        left, known = 0.0, True
        for kind, total in self.total.items():
            remaining = total - self.ended[kind]
            mean = self.mean_seconds(kind)
            known = known and (mean is not None or not remaining)
            left += remaining * (mean or 0.0)
        return left / max(1, cpus), known


class Progress:
    """Watches a run and shows it on `console` (see `dmfc.engine.engine.Watcher`)."""

    def __init__(self, ledger: Ledger, console: Console, kinds: Registry) -> None:
        self._ledger, self._console, self._kinds = ledger, console, kinds
        self._tally = Tally()
        self._live: Live | None = None
        self._cpus = 1
        self._running: Sequence[Job] = ()
        self._started = time.monotonic()

    def begin(self, stages: Sequence[Stage], cpus: int) -> None:
        self._cpus, self._started = cpus, time.monotonic()
        for stage in stages:
            self._tally.total[stage.kind] += 1
        for kind in self._tally.total:
            times = [float(record["seconds"]) for record in self._ledger.records(kind)]
            if times:
                self._tally.seconds[kind] = times[-HISTORY:]
        counts = ", ".join(f"{n} {kind}" for kind, n in self._tally.total.items())
        self._console.print(
            f"{sum(self._tally.total.values())} stages to run: {counts}", soft_wrap=True
        )
        if self._console.is_terminal:
            self._live = Live(console=self._console, refresh_per_second=4, transient=True)
            self._live.start()

    def finished(self, stage: Stage, outcome: Outcome) -> None:
        self._tally.add(stage, outcome)
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
        seconds, known = self._tally.seconds_left(self._cpus)
        return f"{'about' if known else 'more than'} {duration(seconds)} left"

    def _shown(self) -> RenderableType:
        return self._table()

    def _table(self) -> Table:
        table = Table(title=self._time_left(), title_justify="left", expand=False)
        for column in ("stage", "done", "failed", "each", "now"):
            table.add_column(column)
        for kind in self._tally.total:
            mean = self._tally.mean_seconds(kind)
            table.add_row(
                kind,
                f"{self._tally.ended[kind]}/{self._tally.total[kind]}",
                str(self._tally.failed[kind] or ""),
                f"{mean:.1f} s" if mean is not None else "",
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
