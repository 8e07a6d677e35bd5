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


def artifact_location(uri: str) -> str | None:
    """Where a new experiment keeps files: beside a database file; a server decides itself."""
    if not uri.startswith("sqlite:///"):
        return None
    folder = Path(uri.removeprefix("sqlite:///")).parent / "artifacts"
    folder.mkdir(parents=True, exist_ok=True)
    return folder.as_uri()


def artifact_root(ledger: Ledger) -> Path:
    """Where runs keep their files."""
    return ledger.store / "mlflow" / "artifacts"
