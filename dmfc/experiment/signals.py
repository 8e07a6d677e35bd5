"""SIGTERM (Kubernetes, systemd, `timeout`) and SIGHUP (a closed terminal) end a call as Ctrl-C."""

from __future__ import annotations

import signal
from types import FrameType

_received: list[int] = []


def end_as_by_ctrl_c() -> None:
    """From now on both signals raise KeyboardInterrupt; one that is ignored (nohup) stays so."""
    for number in (signal.SIGTERM, signal.SIGHUP):
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, _interrupt)


def interrupted_status() -> int:
    """The exit status after an interruption, as shells have it: 128 + the signal's number."""
    return 128 + (_received[-1] if _received else signal.SIGINT)


def _interrupt(number: int, _: FrameType | None) -> None:
    _received.append(number)
    raise KeyboardInterrupt
