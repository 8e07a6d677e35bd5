"""The best model of a table in MLflow's model registry."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from dmfc.engine.ledger import Ledger
from dmfc.report.table import SweepTable
from dmfc.sweep.record import CellRecord, SweepRecord

if TYPE_CHECKING:
    from mlflow.tracking import MlflowClient

ALIAS = "best"
TAG_STAGE = "dmfc.model_stage"
MODEL = "model"
"""Folder of the weights among a run's files."""


def best_cell(sweep: SweepRecord, table: SweepTable) -> CellRecord | None:
    """The cell of the highest overall rate (then success rate) that has a model; its first seed.

    None if no row with a model has a rate.
    """
    cells: dict[str, CellRecord] = {}
    for cell in sweep.cells:
        if cell.model:
            cells.setdefault(cell.name, cell)
    ranked = [
        (row.rates.overall.value, row.rates.success.value or 0.0, -place, row.name)
        for place, row in enumerate(table.rows)
        if row.name in cells and row.rates.overall.value is not None
    ]
    return cells[max(ranked)[3]] if ranked else None


def register_best(
    client: MlflowClient,
    ledger: Ledger,
    sweep: SweepRecord,
    table: SweepTable,
    runs: Mapping[str, str],
) -> None:
    """Register the best cell's weights as a version of 'dmfc-<sweep>', unless they are there.

    The version's tag names the stage, by which `dmfc store show` finds settings and inputs.
    """
    cell = best_cell(sweep, table)
    if cell is None or cell.model is None:
        return
    name, address = f"dmfc-{sweep.name}", cell.model
    found = {item.name for item in client.search_registered_models(f"name = '{name}'")}
    if name not in found:
        client.create_registered_model(name, description=f"Best model of {sweep.title}")
    for version in client.search_model_versions(f"name = '{name}'"):
        if version.tags.get(TAG_STAGE) == address:
            client.set_registered_model_alias(name, ALIAS, version.version)
            return
    run_id = runs[cell.run]
    client.log_artifacts(run_id, str(ledger.verified(address)), MODEL)
    source = f"{client.get_run(run_id).info.artifact_uri}/{MODEL}"
    tags = {TAG_STAGE: address, "dmfc.sweep": sweep.id, "dmfc.cell": cell.name}
    made = client.create_model_version(name, source, run_id, tags=tags)
    client.set_registered_model_alias(name, ALIAS, made.version)
