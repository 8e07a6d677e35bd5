"""What `dmfc sweep --dry-run` prints."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from dmfc.experiment.console import answer, show_rows

if TYPE_CHECKING:
    from dmfc.engine.ledger import Ledger
    from dmfc.sweep.plan import SweepPlan


def show_plans(plans: Sequence[SweepPlan], ledger: Ledger, as_json: bool) -> None:
    """Every stage of every cell, and whether it is in the ledger; if not, why."""
    from dmfc.engine.explain import reasons
    from dmfc.engine.stage import closure
    from dmfc.pipeline.kinds import KINDS

    described: list[dict[str, Any]] = []
    for plan in plans:
        stages = closure(plan.targets)
        done = {stage.address: ledger.finished(stage.address) for stage in stages}
        cells = []
        for item in plan.cells:
            stages_of_cell = [
                *([item.stages.model] if item.stages.model else []),
                *item.stages.evaluations,
            ]
            cells.append(
                {
                    "cell": item.cell.name,
                    "seed": item.seed,
                    "model": item.stages.model.address if item.stages.model else item.cell.model,
                    "trials": item.trials,
                    "own_stages": len(stages_of_cell),
                    "done": sum(done[stage.address] for stage in stages_of_cell),
                }
            )
        counts, finished = Counter(s.kind for s in stages), Counter[str]()
        for stage in stages:
            finished[stage.kind] += done[stage.address]
        kinds = [{"kind": k, "stages": n, "done": finished[k]} for k, n in counts.items()]
        why = reasons(stages, ledger, KINDS)
        listed = [
            {
                "kind": stage.kind,
                "name": stage.name,
                "key": stage.key,
                "done": done[stage.address],
                "why": why.get(stage.address),
            }
            for stage in stages
        ]
        described.append({"id": plan.id, "cells": cells, "kinds": kinds, "stages": listed})
    if as_json:
        answer(described[0] if len(described) == 1 else {"sweeps": described})
        return
    for shown in described:
        show_rows(f"{shown['id']}: cells", shown["cells"], as_json=False)
        show_rows("stages by kind", shown["kinds"], as_json=False)
        show_rows("stages", shown["stages"], as_json=False)
