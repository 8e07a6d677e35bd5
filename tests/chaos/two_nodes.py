"""A Ray cluster of two nodes on this machine, without a dashboard. One of them can be killed."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from ray.cluster_utils import Cluster

TRIES = 6


def patiently(start: Callable[[], Any], clean: Callable[[], object] = lambda: None) -> Any:
    """What `start` gives. Ray gives a node 30 s to start, which a busy machine may not keep."""
    for tries_left in reversed(range(TRIES)):
        try:
            return start()
        except Exception:  # Ray raises bare ones
            clean()
            if not tries_left:
                raise
    raise AssertionError


class TwoNodes:
    """A head and a worker node with a CPU each; `worker_environment` is of the latter alone."""

    def __init__(self, cpus: int = 1, worker_environment: Mapping[str, str] | None = None) -> None:
        settings = {
            "num_cpus": cpus,
            "object_store_memory": 100 * 2**20,
            "include_dashboard": False,
        }
        self._cluster = patiently(lambda: Cluster(initialize_head=True, head_node_args=settings))
        self._worker = patiently(
            lambda: self._cluster.add_node(**settings, env_vars=dict(worker_environment or {}))
        )

    def __enter__(self) -> TwoNodes:
        return self

    def __exit__(self, *_: object) -> None:
        self._cluster.shutdown()

    @property
    def address(self) -> str:
        return self._cluster.address

    @property
    def worker_id(self) -> str:
        """Ray's id of the node that can be killed."""
        return self._worker.node_id

    def kill_worker_node(self) -> None:
        """SIGKILL its raylet; the workers on it die with it."""
        self._cluster.remove_node(self._worker, allow_graceful=False)
