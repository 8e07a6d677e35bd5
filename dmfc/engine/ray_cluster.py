"""Ray: a new cluster on this machine or the one at `run.ray_address`, and its head."""

from __future__ import annotations

import atexit
import os
import secrets
import signal
import socket
import sys
import threading
import time
from collections.abc import Callable
from typing import Any

from dmfc.config.sweep import RunConfig
from dmfc.errors import DmfcError

OBJECT_STORE_BYTES = 100 * 2**20
"""Ray's shared memory: stages exchange files, so the least it accepts is plenty."""
START_TRIES = 3
KEEP_MEMORY = {"MALLOC_MMAP_MAX_": "0", "MALLOC_TRIM_THRESHOLD_": str(2**30)}
"""glibc's malloc keeps up to this many freed bytes: training asks for the same blocks each step,
and taking them from the system anew costs a fifth of its time. Read when a process starts."""
LOOPBACK = {"RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER": "0"}
"""Ray's switch for a node that listens on 127.0.0.1 alone. Read when Ray is imported."""
HEAD_SECONDS = 45.0
"""A head that is silent for so long is lost. Ray ends this process after 60 s, without a word of
what was computed; a cut link of 20 s must pass."""
LOOK_SECONDS = 2.0


class HeadLostError(DmfcError):
    """The head of the Ray cluster is gone, and with it all that runs there."""


class Head:
    """Looks whether the head of the cluster (Ray's GCS) still takes connections."""

    def __init__(self, address: str) -> None:
        """`address`: host:port of the head; empty where that is not known (a Ray client)."""
        self._address = address
        self._looked = time.monotonic()
        self._silent_since: float | None = None
        self.lost = False
        """Each call of Ray would wait for the head until Ray ends this process."""

    @property
    def answers(self) -> bool:
        """Whether it did at the last look, which is at most 2 s old.

        Ask before each call of Ray that waits for the head without end. Raises HeadLostError where
        it has been silent for `HEAD_SECONDS`.
        """
        now = time.monotonic()
        if self._address and now - self._looked > LOOK_SECONDS:
            self._looked = now
            self._look(now)
        return self._silent_since is None

    def _look(self, now: float) -> None:
        host, _, port = self._address.rpartition(":")
        try:
            socket.create_connection((host.strip("[]"), int(port)), timeout=LOOK_SECONDS).close()
            self._silent_since = None
        except OSError as error:
            self._silent_since = self._silent_since or now
            if now - self._silent_since > HEAD_SECONDS:
                self.lost = True
                raise HeadLostError(
                    f"the head of the Ray cluster at {self._address} has not answered for "
                    f"{HEAD_SECONDS:g} s: {error.strerror or error}"
                ) from error


def start_ray(run: RunConfig) -> None:
    """Start Ray on this machine, or connect to the cluster at `run.ray_address`.

    Tries again: under high load Ray's own processes can miss the 30 s that it gives them.
    Raises DmfcError if the last attempt fails too.
    """
    if not run.ray_address:
        _prepare_local()
    import ray

    for tries_left in reversed(range(START_TRIES)):
        try:
            return _init_ray(run)
        except Exception as error:  # Ray raises bare ones
            ray.shutdown()
            if not tries_left or "AF_UNIX" in str(error):
                raise DmfcError(_why_no_ray(run, error)) from error


def head_address() -> str:
    """host:port of the head of the cluster that this process is connected to."""
    import ray

    return str(ray.get_runtime_context().gcs_address or "")


def leave_ray_behind() -> None:
    """Let this process end without Ray's farewell, which waits for a head that is lost."""

    def end() -> None:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(1)

    atexit.register(end)  # the last one registered is called first


def usable_cpus(run: RunConfig) -> int:
    """CPUs that this process may use, capped by the setting."""
    allowed = len(os.sched_getaffinity(0))
    return min(run.cpus, allowed) if run.cpus else allowed


def _why_no_ray(run: RunConfig, error: Exception) -> str:
    line = (str(error).strip().splitlines() or [type(error).__name__])[0]
    if run.ray_address:
        return f"no Ray cluster answers at '{run.ray_address}' (run.ray_address): {line}"
    if "AF_UNIX" in line:
        return (
            "Ray did not start on this machine: the path of its folder for temporary files is too "
            f"long for its sockets; set TMPDIR (or RAY_TMPDIR) to a shorter one, such as /tmp "
            f"({line})"
        )
    return (
        f"Ray did not start on this machine: {line} (is it very busy, or out of memory? run the "
        "same line again, with a smaller run.cpus, or name a running cluster by run.ray_address)"
    )


def _prepare_local() -> None:
    """Settings of a cluster on this machine: nobody else may use it. Call before Ray's import."""
    # From 2.59 on Ray wants a token of whoever connects to such a cluster. Without one here it
    # writes one into the home folder, for all clusters of the user.
    if "RAY_AUTH_TOKEN_PATH" not in os.environ:
        os.environ.setdefault("RAY_AUTH_TOKEN", secrets.token_hex(32))
    for name, value in {**LOOPBACK, **KEEP_MEMORY}.items():
        os.environ.setdefault(name, value)  # for the workers too, which inherit it


def _init_ray(run: RunConfig) -> None:
    import ray

    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    # Ray 2.60 still hides GPUs from num_gpus=0 tasks; this is the behaviour it announces.
    os.environ.setdefault("RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO", "0")
    quiet: dict[str, Any] = {"log_to_driver": False, "logging_level": "ERROR"}
    if run.ray_address:
        _with_our_sigterm(ray.init, address=run.ray_address, **quiet)
        return
    _with_our_sigterm(
        ray.init,
        address="local",
        num_cpus=usable_cpus(run),
        include_dashboard=False,
        object_store_memory=OBJECT_STORE_BYTES,
        **quiet,
    )


def _with_our_sigterm(init: Callable[..., Any], **settings: Any) -> None:
    """Call `ray.init`, which installs a handler for SIGTERM that raises SystemExit; remove that.

    Not a context manager: the handler may be called between two lines of `__exit__`.
    """
    if threading.current_thread() is not threading.main_thread():
        init(**settings)
        return
    ours = signal.getsignal(signal.SIGTERM)
    try:
        try:
            init(**settings)
        finally:
            signal.signal(signal.SIGTERM, ours)
    except SystemExit as ended:
        signal.signal(signal.SIGTERM, ours)
        if ended.code == signal.SIGTERM:
            signal.raise_signal(signal.SIGTERM)
        raise
