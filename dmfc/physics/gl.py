"""OpenGL contexts for pictures without a screen.

They are made directly, so nobody has to set MUJOCO_GL before MuJoCo is imported; where it is set,
it is obeyed.
"""

from __future__ import annotations

import importlib
import os
from functools import lru_cache
from typing import Any

from dmfc.errors import DmfcError


@lru_cache
def probe() -> str:
    """Why no OpenGL context can be made here, in one line; empty if one can."""
    reasons = []
    for backend in _backends():
        try:
            context = _context(backend, 16, 16)
        except Exception as error:  # the bindings raise whatever their library does, from
            # AttributeError on a missing symbol to their own EGLError
            reasons.append(f"{backend}: {type(error).__name__}")
        else:
            context.free()
            return ""
    return "no OpenGL context (" + ", ".join(reasons) + ")"


def current_context(width: int, height: int) -> Any:
    """A current context of the first backend that works, in pixels; `free` ends it.

    Raises DmfcError if none works.
    """
    for backend in _backends():
        try:
            return _context(backend, width, height)
        except Exception:  # as in `probe`: whatever the binding raises
            continue
    raise DmfcError(f"{probe()}: pictures need EGL, OSMesa or a screen (MUJOCO_GL)")


def _backends() -> list[str]:
    chosen = os.environ.get("MUJOCO_GL", "").lower().strip()
    return [chosen] if chosen in ("egl", "osmesa", "glfw") else ["egl", "osmesa", "glfw"]


def _context(backend: str, width: int, height: int) -> Any:
    """A current OpenGL context of MuJoCo's own binding to `backend`."""
    context = importlib.import_module(f"mujoco.{backend}").GLContext(width, height)
    context.make_current()
    return context
