"""A benchmark beside what it is measured against, in turns."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from typing import Any

RATIOS: list[str] = []


class Compare:
    """Runs `ours` under the benchmark and `other` before each of its rounds.

    The ratios of the medians, of wall and of CPU time, go into `extra_info` beside their limit.
    """

    def __init__(self, benchmark: Any) -> None:
        self.benchmark = benchmark

    def __call__(
        self, ours: Callable[[], Any], other: Callable[[], Any], name: str, limit: float
    ) -> None:
        rounds: dict[str, list[tuple[float, float]]] = {"ours": [], "other": []}

        def timed(key: str, run: Callable[[], Any]) -> None:
            wall, cpu = time.perf_counter(), time.process_time()
            run()
            rounds[key].append((time.perf_counter() - wall, time.process_time() - cpu))

        ours(), other()
        self.benchmark.pedantic(
            lambda: timed("ours", ours), setup=lambda: timed("other", other), rounds=7
        )
        medians = {
            key: [statistics.median(column) for column in zip(*times, strict=True)]
            for key, times in rounds.items()
        }
        wall, cpu = (a / b for a, b in zip(medians["ours"], medians["other"], strict=True))
        self.benchmark.extra_info |= {"to": name, "wall": wall, "cpu": cpu, "limit": limit}
        ours_ms, other_ms = (1000 * medians[key][1] for key in ("ours", "other"))
        RATIOS.append(
            f"{self.benchmark.name}: {wall:.2f} x {name} ({cpu:.2f} in CPU time, "
            f"{ours_ms:.0f} to {other_ms:.0f} ms), limit {limit}"
        )
