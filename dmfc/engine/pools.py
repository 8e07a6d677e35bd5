"""Runs jobs: one after the other in this process, or on Ray."""

from __future__ import annotations

import math
import sys
import time
from collections import deque
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Protocol

from dmfc.config.sweep import RunConfig
from dmfc.engine.context import read_attempt
from dmfc.engine.ledger import Ledger
from dmfc.engine.lookout import held_by
from dmfc.engine.nodes import Node
from dmfc.engine.ray_cluster import Head, head_address, leave_ray_behind, start_ray, usable_cpus
from dmfc.engine.worker import Job, Outcome, execute
from dmfc.errors import first_line

NODE_DEATHS = ("LocalRayletDiedError", "NodeDiedError", "RaySystemError")
"""Errors of Ray after which the cluster of one node that we started is gone."""
DRIVER_NODE_DEATHS = ("LocalRayletDiedError", "RaySystemError")
"""Errors of Ray after which this process must connect to its cluster again."""
CAPACITY_SECONDS = 2.0
"""Time between two looks at how large the cluster is: nodes come and go."""
NODE_LABEL = "ray.io/node-id"
"""Ray's label of a node with its id."""


class Pool(Protocol):
    """Runs jobs; an error is an outcome, never raised."""

    @property
    def cpus(self) -> int:
        """CPUs that jobs can have in all."""

    def nodes(self) -> Sequence[Node]:
        """The living nodes of the cluster; none where jobs run in this process."""

    def submit(self, job: Job) -> None:
        """Queue one job."""

    def wait(self, seconds: float) -> list[tuple[Job, Outcome]]:
        """Jobs finished since the last call; waits up to `seconds` for one."""

    def cancel(self, job: Job) -> None:
        """End the process of a job; its result will not be reported."""

    def close(self, abandon: bool) -> None:
        """Free everything; with `abandon`, stop running jobs first."""


class LocalPool:
    """Runs each job in this process, at the moment somebody waits for it."""

    def __init__(self, run: RunConfig, note: Callable[[str], None] = lambda text: None) -> None:
        """`note` receives the process that a job waits for."""
        self.cpus = usable_cpus(run)
        self._note = note
        self._queue: deque[Job] = deque()

    def nodes(self) -> Sequence[Node]:
        return ()

    def submit(self, job: Job) -> None:
        self._queue.append(job)

    def wait(self, seconds: float) -> list[tuple[Job, Outcome]]:
        if not self._queue:
            return []
        job = self._queue.popleft()

        def waits() -> None:
            self._note(held_by(job, read_attempt(Ledger(Path(job.store)).work(job.address))))

        return [(job, execute(job, waits=waits))]

    def cancel(self, job: Job) -> None:
        self._queue.remove(job)  # what has begun here has also ended

    def close(self, abandon: bool) -> None:
        self._queue.clear()


class RayPool:
    """Runs each job as a Ray task: on this machine, or on the cluster at `run.ray_address`."""

    def __init__(self, run: RunConfig) -> None:
        self._owns = not _connected()
        self._broken = False
        if self._owns:
            start_ray(run)
        import ray  # after the settings of a cluster of ours, some of which it reads here

        self._ray, self._run = ray, run
        self._head = Head(head_address())
        self._nodes: Sequence[Node] = ()
        self._looked = -math.inf
        self._task = ray.remote(_execute_here)
        self._running: dict[Any, Job] = {}
        self._lost: list[Job] = []

    @property
    def cpus(self) -> int:
        """CPUs of the cluster as it is now."""
        return max(1, int(sum(node.cpus for node in self.nodes())))

    def nodes(self) -> Sequence[Node]:
        if time.monotonic() - self._looked > CAPACITY_SECONDS and self._head.answers:
            self._looked = time.monotonic()
            # A client of Ray is outside the cluster and cannot ask the nodes themselves.
            outside = self._run.ray_address.startswith("ray://")
            self._nodes = [
                _node(entry, outside) for entry in self._ray.nodes() if entry.get("Alive")
            ]
        return self._nodes

    def submit(self, job: Job) -> None:
        if self._broken and self._owns:
            self._restart()
        # max_retries=0: the engine counts attempts, so that a death is seen and reported.
        task = self._task.options(
            name=f"{job.kind} {job.name}",
            num_cpus=job.cpus,
            num_gpus=job.gpus,
            memory=int(job.memory_gb * 2**30) or None,
            max_retries=0,
            label_selector={NODE_LABEL: f"!in({','.join(job.avoid)})"} if job.avoid else None,
        )
        self._running[task.remote(job)] = job

    def wait(self, seconds: float) -> list[tuple[Job, Outcome]]:
        if self._lost:
            lost, self._lost = self._lost, []
            return [(job, Outcome("died", reason="Ray died under it")) for job in lost]
        if not self._running:
            return []
        if not self._head.answers:
            time.sleep(seconds)
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
        if self._head.lost:
            leave_ray_behind()
            return
        if abandon:
            for ref in self._running:
                self._ray.cancel(ref, force=True)
        self._running.clear()
        if self._owns:
            self._ray.shutdown()

    def _restart(self) -> None:
        """Ray itself died here: start it again. The next wait reports its jobs as died."""
        self._ray.shutdown()
        self._lost += list(self._running.values())
        self._running.clear()
        start_ray(self._run)
        self._head = Head(head_address())
        self._broken = False

    def _outcome(self, ref: Any) -> Outcome:
        try:
            return self._ray.get(ref)
        except self._ray.exceptions.RayError as error:
            reason = first_line(error)
            deaths = DRIVER_NODE_DEATHS if self._run.ray_address else NODE_DEATHS
            self._broken = self._broken or type(error).__name__ in deaths
            return Outcome("died", reason=f"its worker died ({type(error).__name__}: {reason})")


def _execute_here(job: Job) -> Outcome:
    """The task of Ray: the job, on this node."""
    import ray

    return execute(job, ray.get_runtime_context().get_node_id())


def _node(entry: dict[str, Any], outside: bool) -> Node:
    """A node as `ray.nodes()` lists it."""
    given = entry["Resources"]
    return Node(
        id=entry["NodeID"],
        host=entry["NodeManagerHostname"],
        address=entry["NodeManagerAddress"],
        port=0 if outside else entry["NodeManagerPort"],
        cpus=given.get("CPU", 0.0),
        gpus=given.get("GPU", 0.0),
        memory_gb=given.get("memory", 0.0) / 2**30,
    )


def _connected() -> bool:
    """Whether this process has a Ray already; does not import it."""
    ray = sys.modules.get("ray")
    return ray is not None and bool(ray.is_initialized())
