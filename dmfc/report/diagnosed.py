"""What fine-tuning did to the predictions that it learned from, as a table of a sweep's page."""

from __future__ import annotations

from typing import Any

from dmfc.engine.ledger import Ledger
from dmfc.pipeline.artifacts import load_metrics
from dmfc.sweep.record import SweepRecord

MEASURES = {
    "own_terms_fell": "own terms fell",
    "own_cosine_easy": "cosine, easy 80 %",
    "own_cosine_hard": "cosine, others",
}
"""Diagnostics of `dmfc.training.diagnostics` and their headings; the page says what they mean."""
NORM, AT_LABELS = "gradient_norm_", "_at_labels"


def diagnosed(ledger: Ledger, sweep: SweepRecord) -> dict[str, Any]:
    """Head and lines of the last epoch of each diagnosed model; empty where there is none.

    After the measures, each term that a model has: the norm of its gradient, its mean at labels.
    """
    found: dict[str, tuple[str, dict[str, Any]]] = {}
    for cell in sweep.cells:
        if cell.model and cell.model not in found and ledger.finished(cell.model):
            rows = [r for r in load_metrics(ledger.verified(cell.model)) if r["split"] == "train"]
            if rows and next(iter(MEASURES)) in rows[-1]:
                found[cell.model] = (f"{cell.label}, seed {cell.seed}", rows[-1])
    if not found:
        return {}
    names = {name for _, row in found.values() for name in row if name.startswith(NORM)}
    terms = sorted(name.removeprefix(NORM) for name in names)
    head = [*MEASURES.values(), *terms]
    lines = []
    for label, row in found.values():
        measures = [_number(row.get(name)) for name in MEASURES]
        pairs = [(row.get(f"{NORM}{term}"), row.get(f"{term}{AT_LABELS}")) for term in terms]
        lines.append({"label": label, "cells": [*measures, *(_pair(*pair) for pair in pairs)]})
    return {"head": head, "lines": lines}


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:.2f}"


def _pair(norm: float | None, at_labels: float | None) -> str:
    """'1.2; 0.03': of a term without labels the norm alone."""
    return "; ".join(f"{value:.2g}" for value in (norm, at_labels) if value is not None)
