"""The plan of a search: its cells are trials, and it grows by a round when the last one is done."""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Mapping, Sequence

from dmfc.config.presets import Presets
from dmfc.engine.ledger import Ledger
from dmfc.engine.stage import plain
from dmfc.errors import DmfcError
from dmfc.files.sealed import read_or_replace
from dmfc.pipeline.graph import GraphBuilder
from dmfc.sweep.plan import CellPlan, SweepPlan, plan_cell
from dmfc.sweep.record import SWEEP, VERSION, SearchRecord, SweepRecord
from dmfc.sweep.search import Settings, objective_of, suggest
from dmfc.sweep.sweep_file import BEST, Cell, Sweep, cell_config, seeds_of


class SearchPlanner:
    """Plans of one search. A trial is a cell that is trained and validated, not executed.

    When all trials are made, the best becomes one more cell, which is executed as any other.
    """

    def __init__(
        self,
        sweep: Sweep,
        builder: GraphBuilder,
        preset: Presets | None,
        overrides: Sequence[str],
        ledger: Ledger,
    ) -> None:
        assert sweep.search is not None
        self._sweep, self._search, self._ledger = sweep, sweep.search, ledger
        self._builder, self._preset, self._overrides = builder, preset, overrides
        self._seeds = seeds_of(sweep, preset)
        self._made: dict[tuple[str, int, str], CellPlan] = {}
        self._fixed = self._cells(sweep.cells)
        config = self._fixed[0].config
        if not config.validation.objects:
            raise DmfcError(f"{sweep.path}: a search needs validation.objects, to be judged by")
        self._wanted = config.run.search_trials or self._search.trials
        # All that a trial depends on but its own settings; not how many trials there will be.
        searched = plain(dataclasses.replace(self._search, trials=0))
        base = [cell_config(sweep, Cell("", "", ""), s, preset, overrides) for s in self._seeds]
        self._identity = [searched, [builder.finetune(config, "").key for config in base]]

    def now(self) -> SweepPlan:
        """The plan as far as the store knows its trials."""
        plan = self._plan([], None, ())
        plan = self._plan(_written(plan, self._ledger) or self._next([], []), None, ())
        while all(self._ledger.finished(stage.address) for stage in plan.targets):
            grown = plan.grow(())
            if grown is None:
                break
            plan = grown
        return plan

    def _plan(self, trials: list[Settings], best: int | None, failed: Collection[str]) -> SweepPlan:
        cells = [
            Cell(trial_name(n), f"trial {n}", "finetuned", settings, objective=self._objective)
            for n, settings in enumerate(trials)
        ]
        if best is not None:
            cells.insert(0, Cell(BEST, f"best (trial {best})", "finetuned", trials[best]))
        return SweepPlan(
            self._sweep,
            self._preset,
            (*self._fixed, *self._cells(cells)),
            identity=[*self._identity, *(plan.identity for plan in self._fixed)],
            search=SearchRecord(
                objective=dict(self._objective),
                space=plain(self._search.space),
                wanted=self._wanted,
                trials=tuple(dict(settings) for settings in trials),
                best=best,
            ),
            given_up=frozenset(failed),
            grow=lambda failed: self._grow(trials, best, failed),
        )

    @property
    def _objective(self) -> Mapping[str, float]:
        return self._search.objective

    def _cells(self, cells: Sequence[Cell]) -> tuple[CellPlan, ...]:
        return tuple(self._cell(cell, seed) for seed in self._seeds for cell in cells)

    def _cell(self, cell: Cell, seed: int) -> CellPlan:
        key = cell.name, seed, cell.label
        if key not in self._made:
            self._made[key] = plan_cell(
                self._sweep, cell, seed, self._builder, self._preset, self._overrides
            )
        return self._made[key]

    def _grow(
        self, trials: list[Settings], best: int | None, failed: Collection[str]
    ) -> SweepPlan | None:
        """The plan with the next round, or with the best trial executed; None when all is there."""
        if best is not None:
            return None
        plan = self._plan(trials, None, failed)
        written = _written(plan, self._ledger)
        if len(written) > len(trials):  # another driver was faster
            return self._plan(written, None, failed)
        values = [self._value(plan, trial_name(number)) for number in range(len(trials))]
        if len(trials) < self._wanted:
            return self._plan([*trials, *self._next(trials, values)], None, failed)
        known = [(value, -number) for number, value in enumerate(values) if value is not None]
        # Without any, the first one stands for all: its row says why.
        return self._plan(trials, -max(known)[1] if known else 0, failed)

    def _next(self, trials: list[Settings], values: list[float | None]) -> list[Settings]:
        count = min(self._search.parallel, self._wanted - len(trials))
        return [*suggest(self._search, list(zip(trials, values, strict=True)), count)]

    def _value(self, plan: SweepPlan, name: str) -> float | None:
        """The mean over the seeds; None if one is not there."""
        values = []
        for cell in plan.cells:
            if cell.cell.name == name and cell.stages.model is not None:
                model = cell.stages.model.address
                there = self._ledger.finished(model)
                values.append(objective_of(self._ledger, model, self._objective) if there else None)
        known = [value for value in values if value is not None]
        return sum(known) / len(known) if len(known) == len(values) else None


def trial_name(number: int) -> str:
    """'trial-007'."""
    return f"trial-{number:03d}"


def _written(plan: SweepPlan, ledger: Ledger) -> list[Settings]:
    """The trials that an earlier call has begun."""
    # Where the plan is damaged, the same trials are suggested again, one round after the other.
    folder = plan.folder(ledger)
    if read_or_replace(folder / SWEEP, VERSION) is None:
        return []
    search = SweepRecord.load(folder).search
    return list(search.trials) if search else []
