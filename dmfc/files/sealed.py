"""JSON files that hold their own digest, so that damage is seen when they are read.

A sealed file is an object with `version` and `sha256`, the digest of all the rest of it.
"""

from __future__ import annotations

import json
import logging
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from dmfc.errors import DmfcError
from dmfc.files.atomic import move, write_json
from dmfc.files.digest import json_digest

SEAL = "sha256"
_LOG = logging.getLogger(__name__)


class DamagedError(DmfcError):
    """A file is not what was written: cut short, changed or empty."""


def write_sealed(path: Path, version: int, value: Mapping[str, Any]) -> None:
    """Write `value` with its version and its digest, whole or not at all."""
    content = {**value, "version": version}
    write_json(path, {**content, SEAL: json_digest(content)})


def read_sealed(path: Path, sealed_since: int) -> Any:
    """The content of a file that `write_sealed` wrote, without its digest.

    Files of versions before `sealed_since` have no digest and are taken as they are. Raises
    DamagedError where the file is not what was written, DmfcError where it cannot be opened.
    """
    try:
        content = json.loads(path.read_bytes())
    except OSError as error:
        raise DmfcError(f"'{path}' cannot be read: {error.strerror or error}") from error
    except (ValueError, RecursionError) as error:
        empty = path.stat().st_size == 0
        why = "it is empty" if empty else " ".join(str(error).split())
        raise DamagedError(f"'{path}' is damaged: {why}") from error
    if not isinstance(content, dict):
        return content
    seal = content.pop(SEAL, None)
    version = content.get("version", 0)
    early = isinstance(version, int) and version < sealed_since
    if seal is None and not early:
        raise DamagedError(f"'{path}' is damaged: it has no digest ({SEAL})")
    if seal is not None and seal != json_digest(content):
        raise DamagedError(f"'{path}' is damaged: its content does not fit its digest ({SEAL})")
    return content


def read_or_replace(path: Path, sealed_since: int) -> Any | None:
    """As `read_sealed`; None where there is no such file, or a damaged one.

    A damaged one is set aside as `NAME.damaged`, with a warning, for its writer to write again.
    """
    if not path.is_file():
        return None
    try:
        return read_sealed(path, sealed_since)
    except DamagedError as error:
        aside = path.with_name(f"{path.name}.damaged")
        try:
            move(path, aside)
        except OSError:  # a store that cannot be written
            _LOG.warning("%s; it is not used", error)
        else:
            _LOG.warning("%s; it is set aside as %s and written again", error, aside.name)
        return None
