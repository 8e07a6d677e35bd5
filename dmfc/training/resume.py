"""The checkpoint from which a training resumes: whole, or ignored."""

from __future__ import annotations

import logging
from pathlib import Path

from dmfc.files.atomic import move
from dmfc.files.digest import file_digest

PATTERN = "last-*.ckpt"
_LOG = logging.getLogger(__name__)


def keep_checkpoint(written: Path) -> None:
    """Make a file the only checkpoint of its folder: it is named by its digest."""
    kept = written.with_name(PATTERN.replace("*", file_digest(written)))
    move(written, kept)
    for path in written.parent.glob(PATTERN):
        if path != kept:
            path.unlink()


def last_checkpoint(work: Path) -> Path | None:
    """The latest checkpoint that is what was written; None where there is none.

    Damaged ones are warned of and not used.
    """
    found = sorted(work.glob(PATTERN), key=lambda path: path.stat().st_mtime_ns, reverse=True)
    for path in found:
        if path.name == PATTERN.replace("*", file_digest(path)):
            return path
        _LOG.warning("'%s' is damaged and not used: training begins before it", path)
    return None
