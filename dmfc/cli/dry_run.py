"""What `dmfc sweep --dry-run` prints."""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import typer

from dmfc.experiment.console import answer, show_rows

if TYPE_CHECKING:
    from dmfc.engine.ledger import Ledger
    from dmfc.sweep.plan import SweepPlan


def show_plans(plans: Sequence[SweepPlan], ledger: Ledger, as_json: bool) -> None:
    """Every stage of every cell, and whether it is in the ledger; if not, why.

    And what the sweep will cost here, and which differences it can tell apart.
    """
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
        told = {"cost": _cost(plan, ledger), "power": _power(plan, ledger)}
        described.append({"id": plan.id, "cells": cells, "kinds": kinds, "stages": listed, **told})
    if as_json:
        answer(described[0] if len(described) == 1 else {"sweeps": described})
        return
    for shown in described:
        show_rows(f"{shown['id']}: cells", shown["cells"], as_json=False)
        show_rows("stages by kind", shown["kinds"], as_json=False)
        show_rows("stages", shown["stages"], as_json=False)
        typer.echo(_cost_line(shown["cost"]))
        if shown["power"]:
            typer.echo(shown["power"]["line"])


def _cost(plan: SweepPlan, ledger: Ledger) -> dict[str, Any]:
    """Seconds that what is missing will take on this machine."""
    from dmfc.engine.effort import Times, cost
    from dmfc.engine.engine import unfinished
    from dmfc.engine.ray_cluster import usable_cpus
    from dmfc.pipeline.kinds import KINDS

    missing = list(unfinished(plan.targets, ledger).values())
    times = Times(ledger, KINDS)
    times.learn(stage.kind for stage in missing)
    cpus = usable_cpus(plan.config.run)
    found = cost(missing, times, cpus)
    return {
        "stages": len(missing),
        "cpus": cpus,
        "seconds": round(found.wall, 1),
        "cpu_seconds": {kind: round(seconds, 1) for kind, seconds in found.by_kind.items()},
        "guessed": list(found.guessed),
    }


def _cost_line(cost: dict[str, Any]) -> str:
    from dmfc.engine.watch import duration

    if not cost["stages"]:
        return "Cost: nothing is missing."
    each = ", ".join(f"{kind} {duration(seconds)}" for kind, seconds in cost["cpu_seconds"].items())
    guess = ", ".join(cost["guessed"])
    source = f"by a guess of {guess}" if guess else "from times measured in this store"
    return (
        f"Cost: {cost['stages']} stages, about {duration(cost['seconds'])} on {cost['cpus']} CPUs "
        f"({each} of one CPU), {source}."
    )


def _power(plan: SweepPlan, ledger: Ledger) -> dict[str, Any] | None:
    """What differences its trials can tell apart; None where nothing is executed yet."""
    from dmfc.report.power import power_of

    executed = [item for item in plan.cells if item.trials]
    if not executed:
        return None
    execution, scenes = executed[0].config.execution, executed[0].config.scenes.test.count
    seeds, rows = {item.seed for item in executed}, {item.cell.name for item in executed}
    found = power_of(
        ledger, plan.sweep.name, scenes, execution.grasps_per_scene, len(seeds), len(rows) - 1
    )
    return {**dataclasses.asdict(found), "difference": found.difference(), "line": found.line}
