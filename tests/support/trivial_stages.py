"""Stages without science, to test the engine by. Imported by Ray's workers too."""

import ctypes
import errno
import json
import os
import signal
import time
from pathlib import Path

from dmfc.engine.record import failure_in
from dmfc.errors import DmfcError, MachineError


def add(ctx):
    """Write the sum of `value` and the inputs' sums, and leave a line in the `log` file."""
    folders = [f for name in ctx.inputs for f in ctx.input_list(name)]
    total = ctx.config["value"] + sum(json.loads((f / "sum.json").read_text()) for f in folders)
    (ctx.out / "sum.json").write_text(json.dumps(total))
    if ctx.config.get("log"):
        with Path(ctx.config["log"]).open("a") as log:
            log.write(f"{ctx.name}\n")


def slow(ctx):
    """As `add`, after a while."""
    for step in range(10):
        ctx.progress(step / 10, f"step {step}")
        time.sleep(ctx.config["seconds"] / 10)
    add(ctx)


def gated(ctx):
    """As `add`, once a test has made the file `gate`; says so before."""
    ctx.progress(0.5, "waits at the gate")
    while not Path(ctx.config["gate"]).exists():
        time.sleep(0.02)
    add(ctx)


def fail(ctx):
    """Leave half an output, then raise."""
    (ctx.out / "sum.json").write_text("1")
    if ctx.config.get("user_error"):
        raise DmfcError("the mesh 'x.stl' has no volume")
    raise ValueError("broken on purpose\nsecond line")


def seen(ctx):
    """Write what became of the inputs."""
    (ctx.out / "seen.json").write_text(json.dumps([failure_in(f) for f in ctx.input_list("from")]))


def die_once(ctx):
    """Kill the process at the first attempt; the work folder remembers it."""
    mark = ctx.work / "tried"
    if not mark.exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    add(ctx)


def die(ctx):
    """Kill the process at every attempt."""
    os.kill(os.getpid(), signal.SIGKILL)


def crash(ctx):
    """Read where nothing is, at every attempt."""
    ctypes.string_at(0)


def sick(ctx):
    """Raise an error of the machine: everywhere, or as `add` where the environment has no SICK.

    The file `ran_on` has a line of each attempt; sound ones wait until it has so many sick ones.
    """
    error = ctx.config.get("error") or os.environ.get("SICK")
    if ctx.config.get("ran_on"):
        path = Path(ctx.config["ran_on"])
        while not error and path.read_text().count(" sick\n") < ctx.config["patience"]:
            time.sleep(0.02)
        with path.open("a") as log:
            log.write(f"{ctx.name} {'sick' if error else 'sound'}\n")
    message = "the machine is sick"
    if error == "machine":
        raise MachineError(message)
    if error == "disk":
        raise OSError(errno.EIO, message)
    if error == "memory":
        raise MemoryError(message)
    if error == "package":
        raise ImportError(message)
    if error == "caused by disk":
        try:
            raise OSError(errno.EIO, "no disk")
        except OSError as cause:
            raise DmfcError(message) from cause
    add(ctx)


def threads(ctx):
    """Write how many threads the stage was granted."""
    (ctx.out / "threads.txt").write_text(os.environ["OMP_NUM_THREADS"])
