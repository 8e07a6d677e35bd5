"""Where the tracking database of a store is."""

from __future__ import annotations

from pathlib import Path

from dmfc.sweep.ledger import Ledger

EXPERIMENT = "dmfc"


def database(ledger: Ledger) -> Path:
    """The SQLite file of the store."""
    return ledger.store / "mlflow" / "mlflow.db"


def tracking_uri(ledger: Ledger) -> str:
    """MLflow's URI of that file."""
    return f"sqlite:///{database(ledger)}"


def artifact_root(ledger: Ledger) -> Path:
    """Where runs keep their files."""
    return ledger.store / "mlflow" / "artifacts"
