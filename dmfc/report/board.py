"""The live table of a sweep: per cell its stage, progress, time left and rate so far."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from rich.console import Console, Group, RenderableType
from rich.table import Table

from dmfc.engine.context import read_progress
from dmfc.engine.kinds import Registry
from dmfc.engine.ledger import Ledger
from dmfc.engine.stage import Stage
from dmfc.engine.watch import Progress, duration
from dmfc.engine.worker import Job, Outcome
from dmfc.files.sealed import DamagedError
from dmfc.pipeline.artifacts import load_trials
from dmfc.report.rates import Rate
from dmfc.sweep.record import SweepRecord

LINES = 30
"""Cells shown at once: those at work first."""


@dataclass
class _Line:
    """One cell at one seed, as its own stages stand."""

    label: str
    stages: Sequence[str]
    done: set[str] = field(default_factory=set)
    failed: bool = False
    held: int = 0
    trials: int = 0


class Board(Progress):
    """Progress of sweeps: as `Progress`, with the cells below."""

    def __init__(
        self,
        ledger: Ledger,
        console: Console,
        sweeps: Sequence[SweepRecord],
        kinds: Registry,
    ) -> None:
        super().__init__(ledger, console, kinds)
        self._lines = [
            _Line(f"{sweep.name} {cell.name} seed {cell.seed}", cell.stages)
            for sweep in sweeps
            for cell in sweep.cells
        ]

    def begin(self, stages: Sequence[Stage], cpus: int) -> None:
        """Count what is there already."""
        for line in self._lines:
            for address in line.stages:
                if self._ledger.finished(address):
                    self._add(line, address)
        super().begin(stages, cpus)

    def finished(self, stage: Stage, outcome: Outcome) -> None:
        """Count the stage for each cell that uses it."""
        for line in self._lines:
            if stage.address in line.stages:
                line.failed = line.failed or not outcome.ok
                if outcome.ok:
                    self._add(line, stage.address)
        super().finished(stage, outcome)

    def _add(self, line: _Line, address: str) -> None:
        line.done.add(address)
        if address.startswith("evaluate/"):
            try:
                folder = self._ledger.verified(address)
            except DamagedError as error:  # the table will not be made; the rest may be
                self._console.print(str(error), style="red", markup=False, soft_wrap=True)
                line.failed = True
                return
            rows = load_trials(folder, ["held"])
            line.held += int(rows["held"].sum())
            line.trials += len(rows)

    def _shown(self) -> RenderableType:
        return Group(super()._shown(), self.cells())

    def cells(self) -> Table:
        """The lines of the cells, those at work first."""
        table = Table(expand=False)
        for column in ("cell", "now", "done", "left", "overall so far"):
            table.add_column(column)
        jobs = {job.address: job for job in self._running}
        ordered = sorted(self._lines, key=lambda line: not any(a in jobs for a in line.stages))
        for line in ordered[:LINES]:
            now = self._job(line, jobs)
            rate = Rate(line.held, line.trials)
            table.add_row(
                line.label,
                "failed" if line.failed else now,
                f"{len(line.done)}/{len(line.stages)}",
                self._cell_left(line),
                f"{rate.value:.2f} of {rate.trials}" if rate.value is not None else "",
            )
        if len(ordered) > LINES:
            table.caption = f"and {len(ordered) - LINES} more cells"
        return table

    def _job(self, line: _Line, jobs: Mapping[str, Job]) -> str:
        for address in line.stages:
            if address in jobs and self._ledger.work(address).is_dir():
                fraction, message = read_progress(self._ledger.work(address))
                return f"{jobs[address].kind} {fraction:.0%} {message}".rstrip()
        return "done" if len(line.done) == len(line.stages) else "waits"

    def _cell_left(self, line: _Line) -> str:
        """Time that the cell's own stages still take on one CPU."""
        open_stages = [self._open[address] for address in line.stages if address in self._open]
        if not open_stages or line.failed:
            return ""
        return duration(sum(self._times.estimate(stage).seconds for stage in open_stages))
