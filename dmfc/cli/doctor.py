"""The command `dmfc doctor`: checks this machine, and says how to fix what is missing."""

from __future__ import annotations

import ctypes
import importlib.metadata
import os
import platform
import shutil
import sys
from collections.abc import Callable
from pathlib import Path

import typer

from dmfc.cli.common import STORE, AsJson, Store
from dmfc.experiment.console import show_rows

PACKAGES = (
    "dmfc", "torch", "lightning", "mujoco", "pytorch-kinematics", "ray", "mlflow", "coacd",
    "trimesh", "embreex", "numba", "omegaconf", "pyarrow",
)  # fmt: skip
LIBRARIES = {"libEGL.so.1": "libegl1", "libGL.so.1": "libgl1", "libgomp.so.1": "libgomp1"}
"""Shared libraries and the Debian packages that have them."""
RENDERERS = {
    "embree": "pip install embreex",
    "mujoco": "apt-get install libegl1 libgl1-mesa-dri",
}
"""Depth renderers and what one that does not work may lack."""
FREE_GIB = 5


def doctor(store: Store = STORE, as_json: AsJson = False) -> None:
    """Check versions, processor, renderers, packs, disk and Ray. Status 1 if something is wrong."""
    checks: list[Callable[[], list[dict[str, str]]]] = [
        _python, _packages, _processor, _renderers, _libraries, _packs, lambda: _disk(store),
    ]  # fmt: skip
    rows = [row for check in checks for row in check()]
    show_rows("dmfc doctor", rows, as_json)
    if any(row["state"] == "bad" for row in rows):
        raise typer.Exit(1)


def _row(what: str, state: str, found: str, advice: str = "") -> dict[str, str]:
    return {"check": what, "state": state, "found": found, "advice": advice}


def _python() -> list[dict[str, str]]:
    good = sys.version_info >= (3, 11)
    advice = "" if good else "dmfc needs Python 3.11 or newer"
    return [_row("python", "ok" if good else "bad", platform.python_version(), advice)]


def _packages() -> list[dict[str, str]]:
    rows = []
    for name in PACKAGES:
        try:
            found = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            rows.append(_row(name, "bad", "missing", "pip install dmfc"))
            continue
        wrong = name == "mujoco" and found == "4.0.0"
        advice = "pip install 'mujoco!=4.0.0': its sparse Cholesky is wrong" if wrong else ""
        rows.append(_row(name, "bad" if wrong else "ok", found, advice))
    return rows


def _processor() -> list[dict[str, str]]:
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    info = Path("/proc/cpuinfo")
    flags = info.read_text() if info.is_file() else ""
    wide = [flag for flag in ("avx2", "avx512f") if flag in flags.split()]
    return [_row("processor", "ok", f"{cores} cores, {platform.machine()}, {' '.join(wide)}")]


def _renderers() -> list[dict[str, str]]:
    """What draws depth images, tried as scenes try it; one that works is enough."""
    try:
        from dmfc.sensing.render import available_renderers
    except ImportError as error:  # a package that is missing has a row of its own
        return [_row("renderers", "bad", str(error))]
    reasons = available_renderers()
    chosen = next((name for name, reason in reasons.items() if not reason), None)
    rows = []
    for name, reason in reasons.items():
        found = reason or ("works, the choice of renderer=auto" if name == chosen else "works")
        state = "bad" if chosen is None else "warning" if reason else "ok"
        rows.append(_row(f"renderer {name}", state, found, RENDERERS[name] if reason else ""))
    return rows


def _libraries() -> list[dict[str, str]]:
    missing = {name: package for name, package in LIBRARIES.items() if not _loads(name)}
    if not missing:
        return [_row("system libraries", "ok", ", ".join(LIBRARIES))]
    advice = f"apt-get install {' '.join(missing.values())}"
    return [_row("system libraries", "warning", f"missing: {', '.join(missing)}", advice)]


def _packs() -> list[dict[str, str]]:
    from dmfc.assets import list_packs, status

    rows = []
    for pack in list_packs():
        state = status(pack.name)
        advice = (
            "" if state == "cached" else f"pulled when needed, or: dmfc assets pull {pack.name}"
        )
        rows.append(_row(f"pack {pack.name}", "ok", state, advice))
    return rows


def _disk(store: Path) -> list[dict[str, str]]:
    place = store.absolute()
    while not place.exists():
        place = place.parent
    free = shutil.disk_usage(place).free / 2**30
    advice = (
        "" if free > FREE_GIB else f"a quick sweep wants {FREE_GIB} GiB; choose another --store"
    )
    rows = [
        _row(
            f"disk of {store}",
            "ok" if free > FREE_GIB else "warning",
            f"{free:.0f} GiB free",
            advice,
        )
    ]
    if not os.access(place, os.W_OK):
        rows.append(_row("store", "bad", f"{place} cannot be written", "choose another --store"))
    return rows


def _loads(library: str) -> bool:
    try:
        ctypes.CDLL(library)
    except OSError:
        return False
    return True
