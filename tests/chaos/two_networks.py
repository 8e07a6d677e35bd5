"""A Ray cluster of two nodes in network namespaces, each with an address and a name of its own.

Neither has a route to anywhere else. The link between them can be cut. Needs root and `ip`.
"""

from __future__ import annotations

import contextlib
import os
import secrets
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import psutil

HEAD, WORKER = "10.213.77.1", "10.213.77.2"
PORT = 6379
PATIENCE = 300.0
"""Seconds in which a cluster starts: a bound for what hangs, not for a busy machine."""
PROBE_SECONDS = 120.0
"""Time for one connection to the cluster: Ray looks for names that nobody resolves here."""
RAY = {
    "RAY_AUTH_MODE": "token",
    "RAY_AUTH_TOKEN": secrets.token_hex(32),
    "RAY_USAGE_STATS_ENABLED": "0",
}


class TwoNetworks:
    """A head and a worker node with a CPU each; `worker_environment` is of the latter alone."""

    def __init__(self, worker_environment: Mapping[str, str] | None = None) -> None:
        name = secrets.token_hex(3)
        self._spaces = f"dmfc-{name}-head", f"dmfc-{name}-worker"
        self._links = f"h{name}", f"w{name}"
        self.hosts = f"head-{name}", f"worker-{name}"
        self._worker_environment = worker_environment or {}
        self._nodes: list[subprocess.Popen] = []
        self._beside: list[subprocess.Popen] = []
        self._temporary = Path(tempfile.mkdtemp(prefix="dmfc-"))  # short: it holds Ray's sockets

    @property
    def address(self) -> str:
        """Of the cluster, for a driver in the head's namespace."""
        return f"{HEAD}:{PORT}"

    def __enter__(self) -> TwoNetworks:
        try:
            for space in self._spaces:
                _ip("netns", "add", space)
            _ip("link", "add", self._links[0], "type", "veth", "peer", "name", self._links[1])
            for space, link, at in zip(self._spaces, self._links, (HEAD, WORKER), strict=True):
                _ip("link", "set", link, "netns", space)
                _ip("-n", space, "address", "add", f"{at}/24", "dev", link)
                for device in ("lo", link):
                    _ip("-n", space, "link", "set", device, "up")
            self._start()
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        for process in [*self._beside, *self._nodes]:
            _kill_tree(process)
        for space in self._spaces:
            with contextlib.suppress(subprocess.CalledProcessError):
                _ip("netns", "delete", space)
        shutil.rmtree(self._temporary, ignore_errors=True)

    def run(self, command: Sequence[object], **options: Any) -> subprocess.Popen:
        """Start a command beside the head."""
        environment = {**os.environ, **RAY, **options.pop("env", {})}
        self._beside.append(subprocess.Popen(self._in(0, command), env=environment, **options))
        return self._beside[-1]

    def cut(self) -> None:
        """Cut the link for good: packets vanish, and no connection is closed."""
        _ip("-n", self._spaces[1], "link", "set", self._links[1], "down")

    def power_off(self) -> None:
        """Cut the link, then end the worker node at once: nothing of its end gets through."""
        self.cut()
        _kill_tree(self._nodes[1])

    def _in(self, place: int, command: Sequence[object]) -> list[str]:
        named = 'hostname "$0" && exec "$@"'
        shell = ["unshare", "--uts", "sh", "-c", named, self.hosts[place]]
        return ["ip", "netns", "exec", self._spaces[place], *shell, *map(str, command)]

    def _node(self, place: int) -> subprocess.Popen:
        """Start Ray in the foreground: the head at place 0, the worker at 1."""
        where = f"--node-ip-address={(HEAD, WORKER)[place]}"
        head = ["--head", f"--port={PORT}", "--include-dashboard=false"]
        options = [
            [*head, f"--temp-dir={self._temporary}"],
            [f"--address={self.address}"],
        ][place]
        ray = [sys.executable, "-m", "ray.scripts.scripts", "start", where, *options]
        return subprocess.Popen(
            self._in(place, [*ray, "--num-cpus=1", "--object-store-memory=100000000", "--block"]),
            env={**os.environ, **RAY, **(self._worker_environment if place else {})},
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,  # at its end Ray ends its whole process group
        )

    def _start(self) -> None:
        """Start both nodes: Ray gives each 30 s, a busy machine may need more."""
        end = time.monotonic() + PATIENCE
        self._nodes = [self._node(0), self._node(1)]
        while not self._both_are_there():
            assert time.monotonic() < end, "the two nodes did not find each other"
            for place, process in enumerate(self._nodes):
                if process.poll() is not None:
                    self._nodes[place] = self._node(place)
            time.sleep(0.5)

    def _both_are_there(self) -> bool:
        code = (
            f"import ray; ray.init('{self.address}', log_to_driver=False, logging_level='ERROR');"
            "assert sum(node['Alive'] for node in ray.nodes()) == 2"
        )
        try:
            probe = self.run(
                [sys.executable, "-c", code], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
            )
            return probe.wait(PROBE_SECONDS) == 0
        except subprocess.TimeoutExpired:
            _kill_tree(probe)
            return False


def _ip(*arguments: str) -> None:
    subprocess.run(["ip", *arguments], check=True, capture_output=True)


def _kill_tree(process: subprocess.Popen) -> None:
    """SIGKILL a process and all that it started."""
    with contextlib.suppress(psutil.NoSuchProcess):
        root = psutil.Process(process.pid)
        family = [root, *root.children(recursive=True)]
        for member in family:
            with contextlib.suppress(psutil.NoSuchProcess):
                member.send_signal(signal.SIGSTOP)  # that none is started while they are ended
        for member in [*family, *_children(root)]:
            with contextlib.suppress(psutil.NoSuchProcess):
                member.kill()
    process.wait()


def _children(root: psutil.Process) -> list[psutil.Process]:
    with contextlib.suppress(psutil.NoSuchProcess):
        return root.children(recursive=True)
    return []
