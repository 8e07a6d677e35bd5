"""The nodes of a cluster: their resources, whether they answer, and which ones always fail."""

from __future__ import annotations

import math
import socket
import time
from collections.abc import Callable, Collection, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

from dmfc.engine.worker import Job

NODE_ERRORS = 3
"""Stages in a row that meet an error of the machine on a node, after which it is left out."""
MACHINE_TRIES = 8
"""Nodes on which one stage is tried: one that fails on all of them is not let down by a machine."""
PROBE_SECONDS = 5.0
"""Time between two looks at which nodes answer."""
ANSWER_SECONDS = 3.0
"""Time that a node has to accept a connection."""
SILENT_SECONDS = 25.0
"""A node that has not answered for so long is cut off. Ray itself takes minutes to say so."""


@dataclass(frozen=True)
class Node:
    """A living node of a Ray cluster, and all that it can give."""

    id: str
    host: str
    address: str
    """IP address on which its raylet listens."""
    port: int
    cpus: float
    gpus: float
    memory_gb: float

    def meets(self, job: Job) -> bool:
        """Whether the job could ever run here."""
        return (
            self.id not in job.avoid
            and job.cpus <= self.cpus
            and job.gpus <= self.gpus
            and job.memory_gb <= self.memory_gb
        )


def unmet(job: Job, nodes: Sequence[Node]) -> str:
    """What a job asks for that no node can give, with the settings; '' if one can."""
    if any(node.meets(job) for node in nodes):
        return ""
    asked = [f"{job.cpus:g} CPUs (run.{job.kind}.cpus)"]
    if job.gpus:
        asked.append(f"{job.gpus:g} GPUs (run.{job.kind}.gpus, run.gpus_per_training)")
    if job.memory_gb:
        asked.append(f"{job.memory_gb:g} GB of memory (run.{job.kind}.memory_gb)")
    there = sorted({f"{n.cpus:g} CPUs, {n.gpus:g} GPUs, {n.memory_gb:.1f} GB" for n in nodes})
    nodes_left = "without those that have failed " if job.avoid else ""
    return f"no node {nodes_left}can give {', '.join(asked)}; there are nodes with: " + (
        "; ".join(there) or "none"
    )


class NodeErrors:
    """Errors of machines: on which nodes a stage met one, and which nodes are left out."""

    def __init__(self) -> None:
        self.left_out: set[str] = set()
        self._met: dict[str, set[str]] = {}
        self._in_a_row: dict[str, set[str]] = {}

    def met(self, address: str) -> frozenset[str]:
        """Nodes on which this stage met an error of the machine."""
        return frozenset(self._met.get(address, ()))

    def add(self, address: str, node: str) -> None:
        """A stage met an error of the machine on this node."""
        self._met.setdefault(address, set()).add(node)
        self._in_a_row.setdefault(node, set()).add(address)

    def succeeded(self, node: str) -> None:
        """A stage was finished on this node."""
        self._in_a_row.pop(node, None)

    def acquit(self, address: str) -> None:
        """This stage fails on every node: no node is to blame."""
        for stages in self._in_a_row.values():
            stages.discard(address)

    def leave_out(self, node: str, nodes: Sequence[Node]) -> bool:
        """Leave the node out if it fails repeatedly and is not the last; whether that is new."""
        rest = {other.id for other in nodes} - self.left_out - {node}
        if node in self.left_out or len(self._in_a_row.get(node, ())) < NODE_ERRORS or not rest:
            return False
        self.left_out.add(node)
        return True


class Silence:
    """Which nodes no longer accept a connection, and since when."""

    def __init__(self, answers: Callable[[Node], bool] | None = None) -> None:
        self._answers = answers or _answers
        self._since: dict[str, float] = {}
        self._next = 0.0

    def cut_off(self, nodes: Collection[Node]) -> list[Node]:
        """The nodes that have not answered for `SILENT_SECONDS`. Takes seconds if one is silent."""
        now = time.monotonic()
        if now >= self._next and nodes:
            self._next = now + PROBE_SECONDS
            with ThreadPoolExecutor(min(32, len(nodes))) as threads:
                for node, answered in zip(nodes, threads.map(self._answers, nodes), strict=True):
                    if answered:
                        self._since.pop(node.id, None)
                    else:
                        self._since.setdefault(node.id, now)
        long_ago = time.monotonic() - SILENT_SECONDS
        return [node for node in nodes if self._since.get(node.id, math.inf) <= long_ago]


def _answers(node: Node) -> bool:
    try:
        with socket.create_connection((node.address, node.port), ANSWER_SECONDS):
            return True
    except OSError:
        return False
