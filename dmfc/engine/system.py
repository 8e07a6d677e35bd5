"""CPU, memory and GPU that a stage uses, sampled while it runs."""

from __future__ import annotations

import json
import shutil
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from dmfc.files.atomic import write_text

SAMPLES = "system.jsonl"
"""A line per sample: `time` (s since 1970) and the measures by name."""
MEGABYTE = 2**20


@contextmanager
def sampled(work: Path, seconds: float, gpus: float) -> Iterator[None]:
    """Append a sample to `work` every so many seconds; 0 takes none. Short stages leave no file.

    A later attempt goes on in the same file, so the samples of one stage are numbered through.
    """
    if seconds <= 0:
        yield
        return
    stop = threading.Event()
    thread = threading.Thread(target=_sample, args=(work, seconds, gpus, stop), daemon=True)
    thread.start()
    try:
        yield
    finally:
        stop.set()
        thread.join()


def read_lines(path: Path, growing: bool = True) -> list[dict[str, Any]]:
    """The lines of a file, without a last one that is `growing`; none if it is not there."""
    try:
        text = path.read_text()
    except FileNotFoundError:
        return []
    end = text.rfind("\n") + 1 if growing else len(text)
    return [json.loads(line) for line in text[:end].splitlines()]


def _whole_lines(path: Path) -> list[str]:
    """The lines that earlier attempts left, but for those that a power cut tore."""
    whole = []
    for line in path.read_bytes().splitlines() if path.is_file() else []:
        try:
            whole.append(json.dumps(json.loads(line)) + "\n")
        except ValueError:
            continue
    return whole


def keep_samples(work: Path, out: Path) -> None:
    """Put the samples beside the outputs of a stage."""
    if (work / SAMPLES).is_file():
        shutil.copyfile(work / SAMPLES, out / SAMPLES)


def _sample(work: Path, seconds: float, gpus: float, stop: threading.Event) -> None:
    if stop.wait(seconds):
        return
    import psutil

    process, gpu = psutil.Process(), _gpu_reader(gpus)
    process.cpu_percent()  # the first call starts the clock
    path = work / SAMPLES
    write_text(path, "".join(_whole_lines(path)))
    while not stop.wait(seconds):
        line = {
            "time": round(time.time(), 3),
            "cpu_utilization_percentage": process.cpu_percent(),
            "system_memory_usage_megabytes": round(process.memory_info().rss / MEGABYTE, 1),
            "machine_cpu_percentage": psutil.cpu_percent(),
            **gpu(),
        }
        with path.open("a") as out:
            out.write(json.dumps(line) + "\n")


def _gpu_reader(gpus: float) -> Callable[[], dict[str, float]]:
    """Memory and use of the first GPU that this stage was granted."""
    if not gpus:
        return dict
    import torch

    def read() -> dict[str, float]:
        if not torch.cuda.is_available():
            return {}
        free, total = torch.cuda.mem_get_info()
        return {
            "gpu_0_memory_usage_megabytes": round((total - free) / MEGABYTE, 1),
            "gpu_0_memory_usage_percentage": round(100 * (1 - free / total), 1),
        }

    return read
