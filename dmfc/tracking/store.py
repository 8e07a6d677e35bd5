"""Where the tracking database of a store is."""

from __future__ import annotations

import time
import urllib.error
import urllib.request
from pathlib import Path

from dmfc.engine.ledger import Ledger
from dmfc.errors import DmfcError

EXPERIMENT = "dmfc"
ATTEMPTS, ATTEMPT_SECONDS = 3, 10.0
"""How often a server is asked whether it is there, and how long each time."""


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


def is_server(uri: str) -> bool:
    """Whether the URI names a server, whose pages have the same address."""
    return uri.startswith(("http://", "https://"))


def require_answer(uri: str) -> None:
    """Raises DmfcError where no server answers at an HTTP URI. MLflow itself tries for minutes."""
    if not is_server(uri):
        return
    for left in reversed(range(ATTEMPTS)):
        try:
            with urllib.request.urlopen(f"{uri.rstrip('/')}/health", timeout=ATTEMPT_SECONDS):
                return
        except urllib.error.HTTPError:
            return  # it is there; what it says is MLflow's business
        except OSError as error:
            if not left:
                reason = getattr(error, "reason", error)
                raise DmfcError(
                    f"no MLflow server answers at '{uri}': {reason} (run.tracking_uri; `dmfc "
                    "tracking sync` writes what is missing)"
                ) from error
            time.sleep(1)
