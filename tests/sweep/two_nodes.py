"""A Ray cluster of two nodes on this machine, without a dashboard. One of them can be killed."""

from __future__ import annotations

from ray.cluster_utils import Cluster

HELD = "held.json"
"""Where a stage that a test holds says its process and its node."""


class TwoNodes:
    """A head and a worker node with a CPU each."""

    def __init__(self, cpus: int = 1) -> None:
        settings = {
            "num_cpus": cpus,
            "object_store_memory": 100 * 2**20,
            "include_dashboard": False,
        }
        self._cluster = Cluster(initialize_head=True, head_node_args=settings)
        self._worker = self._cluster.add_node(**settings)

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
