"""Where jobs run: in this process one after the other, or on Ray."""

from __future__ import annotations

import os
from collections import deque
from typing import Any, Protocol

from dmfc.config.sweep import RunConfig
from dmfc.sweep.worker import Job, Outcome, execute

OBJECT_STORE_BYTES = 100 * 2**20
"""Ray's shared memory: stages exchange files, so the least it accepts is plenty."""


NODE_DEATHS = ("LocalRayletDiedError", "NodeDiedError", "RaySystemError")
"""Errors of Ray after which the cluster that we started is gone."""


class Pool(Protocol):
    """Runs jobs; an error is an outcome, never raised."""

    cpus: int

    def submit(self, job: Job) -> None:
        """Queue one job."""

    def wait(self, seconds: float) -> list[tuple[Job, Outcome]]:
        """Jobs finished since the last call; waits up to `seconds` for one."""

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
            _start_ray(run)
        self.cpus = int(ray.cluster_resources().get("CPU", 1))
        self._task = ray.remote(execute)
        self._running: dict[Any, Job] = {}
        self._lost: list[Job] = []

    def submit(self, job: Job) -> None:
        if self._broken and self._owns:
            self._restart()
        # max_retries=0: the engine counts attempts, so that a death is seen and told.
        task = self._task.options(
            name=f"{job.kind} {job.name}", num_cpus=job.cpus, num_gpus=job.gpus, max_retries=0
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
        _start_ray(self._run)
        self._broken = False

    def _outcome(self, ref: Any) -> Outcome:
        try:
            return self._ray.get(ref)
        except self._ray.exceptions.RayError as error:
            reason = str(error).strip().splitlines()[0]
            self._broken = self._broken or type(error).__name__ in NODE_DEATHS
            return Outcome("died", reason=f"its worker died ({type(error).__name__}: {reason})")


def usable_cpus(run: RunConfig) -> int:
    """CPUs that this process may use, capped by the setting."""
    allowed = len(os.sched_getaffinity(0))
    return min(run.cpus, allowed) if run.cpus else allowed


def _start_ray(run: RunConfig) -> None:
    import ray

    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    # Ray 2.60 still hides GPUs from num_gpus=0 tasks; this is the behaviour it announces.
    os.environ.setdefault("RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO", "0")
    quiet: dict[str, Any] = {"log_to_driver": False, "logging_level": "ERROR"}
    if run.ray_address:
        ray.init(address=run.ray_address, **quiet)
        return
    ray.init(
        address="local",
        num_cpus=usable_cpus(run),
        include_dashboard=False,
        object_store_memory=OBJECT_STORE_BYTES,
        **quiet,
    )
