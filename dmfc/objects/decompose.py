"""CoACD in a separate process: `python -m dmfc.objects.decompose IN.npz OUT.npz SECONDS`.

On a few meshes CoACD 1.0 ends its process (an assertion of its triangulation, or a segmentation
fault), which nothing in that process can catch.
"""

from __future__ import annotations

import signal
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from dmfc.errors import DmfcError, MachineError

CRASHES = {-signal.SIGSEGV, -signal.SIGABRT, -signal.SIGFPE}
"""Status of a process that CoACD ended. Other signals come from outside: the kernel, a person."""
REFUSED = 3
"""Exit status where CoACD raised an error of its own."""

CPU_LIMIT = 1200
"""Seconds of all threads: the same verdict on a busy machine. Objects of the packs need less than
two minutes."""
WALL_LIMIT = 7200
"""Seconds after which nothing is expected any more."""


def decompose(vertices: np.ndarray, faces: np.ndarray, **options: Any) -> list[np.ndarray] | None:
    """Points [n, 3] of each convex part by `coacd.run_coacd`; None where CoACD crashed.

    Raises DmfcError where CoACD refused the mesh or did not end within `CPU_LIMIT`, and
    MachineError where its process failed otherwise (no CoACD, no memory, no disk, killed).
    """
    with tempfile.TemporaryDirectory(prefix="dmfc-coacd-") as folder:
        asked, answer = Path(folder, "asked.npz"), Path(folder, "parts.npz")
        np.savez(asked, vertices=vertices, faces=faces, **options)
        command = [sys.executable, "-P", "-m", __name__, str(asked), str(answer)]
        try:
            ended = subprocess.run(
                [*command, str(CPU_LIMIT)],
                check=False,
                capture_output=True,
                text=True,
                timeout=WALL_LIMIT,
            )
        except subprocess.TimeoutExpired as error:
            raise MachineError(
                f"the convex decomposition did not end within {WALL_LIMIT} s: this machine is "
                "overloaded"
            ) from error
        if ended.returncode == -signal.SIGXCPU:
            raise DmfcError(
                f"the convex decomposition did not end within {CPU_LIMIT} s of CPU time "
                "(objects.prepare.convex_*); do faces of the mesh cross each other?"
            )
        short_of_memory = "bad_alloc" in ended.stderr
        if ended.returncode in CRASHES and not short_of_memory:
            return None
        if ended.returncode:
            signalled = f"its process was killed (signal {-ended.returncode})"
            lines = ended.stderr.strip().splitlines() or [signalled]
            kind = DmfcError if ended.returncode == REFUSED else MachineError
            raise kind(f"the convex decomposition failed: {lines[-1]}")
        with np.load(answer) as parts:
            return [parts[f"arr_{k}"] for k in range(len(parts.files))]


def _run(asked: str, answer: str, cpu_limit: str) -> None:
    import resource

    resource.setrlimit(resource.RLIMIT_CPU, (int(cpu_limit), int(cpu_limit) + 5))
    import coacd

    coacd.set_log_level("error")
    with np.load(asked) as given:
        options = {name: given[name] for name in given.files}
    try:
        mesh = coacd.Mesh(options.pop("vertices"), options.pop("faces"))
        parts = coacd.run_coacd(mesh, **{name: value.item() for name, value in options.items()})
    except (RuntimeError, ValueError) as error:
        print(error, file=sys.stderr)
        sys.exit(REFUSED)
    np.savez(answer, *(np.asarray(points) for points, _ in parts))


if __name__ == "__main__":
    _run(*sys.argv[1:])
