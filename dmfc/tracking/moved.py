"""Corrects the absolute addresses of files in MLflow after a store has moved."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from pathlib import Path
from urllib.parse import quote

from dmfc.errors import DmfcError

EXPERIMENT = "dmfc"
DEFAULT = "Default"
"""MLflow's experiment 0, which it would keep in the folder that a program is called in."""
ADDRESSES = (
    ("experiments", "artifact_location"),
    ("runs", "artifact_uri"),
    ("model_versions", "source"),
    ("model_versions", "storage_location"),
    ("logged_models", "artifact_location"),
)
"""Tables and columns of MLflow 3 with addresses of files."""


def set_locations(database: Path, artifacts: Path) -> None:
    """Let every address in the database that is under its old place of files be under `artifacts`.

    Does nothing where there is no such file or all is right. Raises DmfcError where the database
    cannot be read or written.
    """
    if not database.is_file():
        return
    try:
        with closing(sqlite3.connect(database, timeout=60.0, isolation_level=None)) as connection:
            if not _right(connection, artifacts.as_uri()):
                connection.execute("BEGIN IMMEDIATE")  # of two processes one does it
                _move(connection, artifacts.as_uri())
                connection.execute("COMMIT")
    except sqlite3.Error as error:
        raise DmfcError(
            f"MLflow's database '{database}' cannot be used: {error} (set it aside: `dmfc "
            "tracking rebuild` makes it again from the store)"
        ) from error


def copy_database(database: Path, copy: Path) -> None:
    """A copy of a database that others may be writing. Raises DmfcError where it is unreadable."""
    try:
        with (
            closing(sqlite3.connect(f"file:{quote(str(database))}?mode=ro", uri=True)) as source,
            closing(sqlite3.connect(copy)) as target,
        ):
            source.backup(target)
    except sqlite3.Error as error:
        raise DmfcError(f"MLflow's database '{database}' cannot be read: {error}") from error


def _locations(connection: sqlite3.Connection) -> dict[str, str]:
    """Where each experiment keeps files; empty in a database without MLflow's tables."""
    if "artifact_location" not in _columns(connection, "experiments"):
        return {}
    return dict(connection.execute("SELECT name, artifact_location FROM experiments").fetchall())


def _right(connection: sqlite3.Connection, new: str) -> bool:
    found = _locations(connection)
    return found.get(EXPERIMENT, new) == new and found.get(DEFAULT, new).startswith(new)


def _move(connection: sqlite3.Connection, new: str) -> None:
    found = _locations(connection)
    old = found.get(EXPERIMENT, new)
    for table, column in ADDRESSES if old != new else ():
        if column in _columns(connection, table):
            connection.execute(
                f"UPDATE {table} SET {column} = ? || substr({column}, ?) "
                f"WHERE {column} = ? OR substr({column}, 1, ?) = ?",
                (new, len(old) + 1, old, len(old) + 1, f"{old}/"),
            )
    if DEFAULT in found and not found[DEFAULT].startswith(old):
        connection.execute(
            "UPDATE experiments SET artifact_location = ? WHERE name = ?", (f"{new}/0", DEFAULT)
        )


def _columns(connection: sqlite3.Connection, table: str) -> set[str]:
    return {row[1] for row in connection.execute(f"PRAGMA table_info({table})")}
