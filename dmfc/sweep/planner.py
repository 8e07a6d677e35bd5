"""The plan of a sweep file: every cell at every seed; of a search, the trials known so far."""

from __future__ import annotations

from collections.abc import Sequence

from dmfc.config.presets import Presets
from dmfc.engine.ledger import Ledger
from dmfc.pipeline.graph import GraphBuilder
from dmfc.sweep.plan import SweepPlan, plan_cell
from dmfc.sweep.search_plan import SearchPlanner
from dmfc.sweep.sweep_file import Sweep, seeds_of


def plan_sweep(
    sweep: Sweep,
    builder: GraphBuilder,
    preset: Presets | None,
    overrides: Sequence[str] = (),
    ledger: Ledger | None = None,
) -> SweepPlan:
    """Resolve every cell at every seed. Raises DmfcError on the first setting that is wrong.

    A search needs the `ledger` too: what it tries next depends on what it has found.
    """
    if sweep.search is not None:
        assert ledger is not None, "a search is planned with its ledger"
        return SearchPlanner(sweep, builder, preset, overrides, ledger).now()
    cells = [
        plan_cell(sweep, cell, seed, builder, preset, overrides)
        for seed in seeds_of(sweep, preset)
        for cell in sweep.cells
    ]
    return SweepPlan(sweep, preset, tuple(cells))
