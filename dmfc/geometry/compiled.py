"""Whether work on the CPU goes through the compiled loops, or through torch's operations.

Both give the same answers. The loops are several times as fast, once a few seconds have been spent
on compiling them: a process that handles a single cloud is faster without them.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

_USED = ContextVar("dmfc.compiled", default=True)


def compiled_loops() -> bool:
    """Whether they are used, here and now."""
    return _USED.get()


@contextmanager
def with_compiled_loops(used: bool) -> Iterator[None]:
    """Within it, in this thread, the loops are used or not."""
    token = _USED.set(used)
    try:
        yield
    finally:
        _USED.reset(token)
