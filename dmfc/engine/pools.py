"""Where jobs run: in this process one after the other, or on Ray."""

from __future__ import annotations

import math
import os
import time
from collections import deque
from typing import Any, Protocol

from dmfc.config.sweep import RunConfig
from dmfc.engine.worker import Job, Outcome, execute
from dmfc.errors import DmfcError, first_line

OBJECT_STORE_BYTES = 100 * 2**20
"""Ray's shared memory: stages exchange files, so the least it accepts is plenty."""


NODE_DEATHS = ("LocalRayletDiedError", "NodeDiedError", "RaySystemError")
"""Errors of Ray after which the cluster of one node that we started is gone."""
DRIVER_NODE_DEATHS = ("LocalRayletDiedError", "RaySystemError")
"""Errors of Ray after which this process must connect to its cluster anew."""
START_TRIES = 3
CAPACITY_SECONDS = 5.0
"""Time between two looks at how large the cluster is: nodes come and go."""


KEEP_MEMORY = {"MALLOC_MMAP_MAX_": "0", "MALLOC_TRIM_THRESHOLD_": str(2**30)}
"""glibc's malloc keeps up to this many freed bytes: training asks for the same blocks each step,
and taking them from the system anew costs a fifth of its time. Read when a process starts."""


class Pool(Protocol):
    """Runs jobs; an error is an outcome, never raised."""

    @property
    def cpus(self) -> int:
        """CPUs that jobs can have in all."""

    def submit(self, job: Job) -> None:
        """Queue one job."""

    def wait(self, seconds: float) -> list[tuple[Job, Outcome]]:
        """Jobs finished since the last call; waits up to `seconds` for one."""

    def cancel(self, job: Job) -> None:
        """End the process of a job; nothing of it will be told."""

    def close(self, abandon: bool) -> None:
        """Free everything; with `abandon`, stop running jobs first."""


class LocalPool:
    """Runs each job in this process, at the moment somebody waits for it."""

    def __init__(self, run: RunConfig) -> None:
        self.cpus = usable_cpus(run)
        self._queue: deque[Job] = deque()

    def submit(self, job: Job) -> None:
        self._queue.append(job)

    def wait(self, seconds: float) -> list[tuple[Job, Outcome]]:
        if not self._queue:
            return []
        job = self._queue.popleft()
        return [(job, execute(job))]

    def cancel(self, job: Job) -> None:
        self._queue.remove(job)  # what has begun here has also ended

    def close(self, abandon: bool) -> None:
        self._queue.clear()


class RayPool:
    """Runs each job as a Ray task: on this machine, or on the cluster at `run.ray_address`."""

    def __init__(self, run: RunConfig) -> None:
        import ray

        self._ray, self._run = ray, run
        self._owns = not ray.is_initialized()
        self._broken = False
        if self._owns:
            start_ray(run)
        self._cpus, self._looked = 1, -math.inf
        self._task = ray.remote(execute)
        self._running: dict[Any, Job] = {}
        self._lost: list[Job] = []

    @property
    def cpus(self) -> int:
        """CPUs of the cluster as it is now."""
        if time.monotonic() - self._looked > CAPACITY_SECONDS:
            self._looked = time.monotonic()
            self._cpus = max(1, int(self._ray.cluster_resources().get("CPU", 1)))
        return self._cpus

    def submit(self, job: Job) -> None:
        if self._broken and self._owns:
            self._restart()
        # max_retries=0: the engine counts attempts, so that a death is seen and told.
        task = self._task.options(
            name=f"{job.kind} {job.name}",
            num_cpus=job.cpus,
            num_gpus=job.gpus,
            memory=int(job.memory_gb * 2**30) or None,
            max_retries=0,
        )
        self._running[task.remote(job)] = job

    def wait(self, seconds: float) -> list[tuple[Job, Outcome]]:
        if self._lost:
            lost, self._lost = self._lost, []
            return [(job, Outcome("died", reason="Ray died under it")) for job in lost]
        if not self._running:
            return []
        ready, rest = self._ray.wait(list(self._running), num_returns=1, timeout=seconds)
        if ready and rest:
            ready += self._ray.wait(rest, num_returns=len(rest), timeout=0)[0]
        return [(self._running.pop(ref), self._outcome(ref)) for ref in ready]

    def cancel(self, job: Job) -> None:
        for ref in [ref for ref, known in self._running.items() if known is job]:
            del self._running[ref]
            self._ray.cancel(ref, force=True)

    def close(self, abandon: bool) -> None:
        if abandon:
            for ref in self._running:
                self._ray.cancel(ref, force=True)
        self._running.clear()
        if self._owns:
            self._ray.shutdown()

    def _restart(self) -> None:
        """Ray itself died here: start it again. What ran on it is told as died by the next wait."""
        self._ray.shutdown()
        self._lost += list(self._running.values())
        self._running.clear()
        start_ray(self._run)
        self._broken = False

    def _outcome(self, ref: Any) -> Outcome:
        try:
            return self._ray.get(ref)
        except self._ray.exceptions.RayError as error:
            reason = first_line(error)
            deaths = DRIVER_NODE_DEATHS if self._run.ray_address else NODE_DEATHS
            self._broken = self._broken or type(error).__name__ in deaths
            return Outcome("died", reason=f"its worker died ({type(error).__name__}: {reason})")


def usable_cpus(run: RunConfig) -> int:
    """CPUs that this process may use, capped by the setting."""
    allowed = len(os.sched_getaffinity(0))
    return min(run.cpus, allowed) if run.cpus else allowed


def start_ray(run: RunConfig) -> None:
    """Start Ray on this machine, or connect to the cluster at `run.ray_address`.

    Tries again: under high load Ray's own processes can miss the 30 s that it gives them.
    Raises DmfcError if the last attempt fails too.
    """
    import ray

    for tries_left in reversed(range(START_TRIES)):
        try:
            return _init_ray(run)
        except Exception as error:  # Ray raises bare ones
            ray.shutdown()
            if not tries_left:
                raise DmfcError(_why_no_ray(run, error)) from error


def _why_no_ray(run: RunConfig, error: Exception) -> str:
    line = (str(error).strip().splitlines() or [type(error).__name__])[0]
    if run.ray_address:
        return f"no Ray cluster answers at '{run.ray_address}' (run.ray_address): {line}"
    return (
        f"Ray did not start on this machine: {line} (is it very busy, or out of memory? run the "
        "same line again, with a smaller run.cpus, or name a running cluster by run.ray_address)"
    )


def _init_ray(run: RunConfig) -> None:
    import ray

    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    # Ray 2.60 still hides GPUs from num_gpus=0 tasks; this is the behaviour it announces.
    os.environ.setdefault("RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO", "0")
    quiet: dict[str, Any] = {"log_to_driver": False, "logging_level": "ERROR"}
    if run.ray_address:
        ray.init(address=run.ray_address, **quiet)
        return
    for name, value in KEEP_MEMORY.items():
        os.environ.setdefault(name, value)  # for the workers, which inherit it
    ray.init(
        address="local",
        num_cpus=usable_cpus(run),
        include_dashboard=False,
        object_store_memory=OBJECT_STORE_BYTES,
        **quiet,
    )
