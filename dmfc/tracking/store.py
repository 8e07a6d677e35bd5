"""Where the tracking database of a store is, and how its server is reached."""

from __future__ import annotations

import os
import re
import time
import urllib.error
import urllib.request
from pathlib import Path
from urllib.parse import quote, unquote, urlsplit, urlunsplit

from dmfc.engine.ledger import Ledger
from dmfc.errors import DmfcError, masked

ATTEMPTS, ATTEMPT_SECONDS = 3, 10.0
"""How often a server is asked whether it is there, and how long each time."""
LOOPBACK = ("localhost", "127.0.0.1", "::1")


def database(ledger: Ledger) -> Path:
    """The SQLite file of the store."""
    return ledger.store / "mlflow" / "mlflow.db"


def artifact_root(ledger: Ledger) -> Path:
    """Where runs keep their files."""
    return artifacts_beside(database(ledger))


def tracking_uri(ledger: Ledger) -> str:
    """MLflow's URI of the store's own database."""
    return sqlite_uri(database(ledger))


def sqlite_uri(path: Path) -> str:
    """MLflow's URI of an SQLite file, `?`, `%` and the like quoted."""
    quoted = quote(str(path))
    # Of 'sqlite:///' MLflow itself makes the folder, of the name as it is quoted.
    return f"{'sqlite' if quoted == str(path) else 'sqlite+pysqlite'}:///{quoted}"


def sqlite_path(uri: str) -> Path | None:
    """The file of an SQLite URI; None for any other URI."""
    found = re.fullmatch(r"sqlite(?:\+\w+)?:///([^?]+)(?:\?.*)?", uri)
    return Path(unquote(found[1])).absolute() if found else None


def artifacts_beside(path: Path) -> Path:
    """Where the runs in a database file keep their files."""
    return path.parent / "artifacts"


def is_server(uri: str) -> bool:
    """Whether the URI names a server, whose pages have the same address."""
    return uri.startswith(("http://", "https://"))


def without_user(uri: str) -> str:
    """The URI without user and password, as it may be shown and kept."""
    try:
        parts = urlsplit(uri)
    except ValueError:  # no URI at all
        return masked(uri)
    _, at, host = parts.netloc.rpartition("@")
    return masked(urlunsplit(parts._replace(netloc=host)) if at else uri)


def reach_loopback_directly() -> None:
    """Let no proxy of the environment stand between processes of this machine, ours included."""
    given = os.environ.get("no_proxy") or os.environ.get("NO_PROXY") or ""
    names = [name for name in given.replace(" ", "").split(",") if name]
    wanted = ",".join([*names, *(name for name in LOOPBACK if name not in names)])
    os.environ["no_proxy"] = os.environ["NO_PROXY"] = wanted


def require_answer(uri: str) -> None:
    """Raises DmfcError where no server answers at an HTTP URI. MLflow itself tries for minutes."""
    if not is_server(uri):
        return
    reach_loopback_directly()
    for left in reversed(range(ATTEMPTS)):
        try:
            at = f"{without_user(uri).rstrip('/')}/health"
            with urllib.request.urlopen(at, timeout=ATTEMPT_SECONDS):
                return
        except urllib.error.HTTPError:
            return  # it is there; what it says is MLflow's business
        except (OSError, ValueError) as error:
            if not left:
                reason = getattr(error, "reason", error)
                raise DmfcError(
                    f"no MLflow server answers at '{uri}': {reason} (run.tracking_uri; `dmfc "
                    "tracking sync` writes what is missing)"
                ) from error
            time.sleep(1)
