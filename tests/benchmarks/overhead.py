"""What the engine costs per stage: 2,000 trivial stages on Ray, and the same call again.

python -m tests.benchmarks.overhead [stages]
"""

from __future__ import annotations

import os
import resource
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


def main(count: int) -> None:
    """Print seconds per stage, seconds of the second call, and the driver's peak memory."""
    os.environ["PYTHONPATH"] = str(ROOT)
    import ray

    from dmfc.config.schema import Config
    from dmfc.engine.engine import run_stages
    from dmfc.engine.ledger import Ledger
    from tests.support.trivial_graph import TRIVIAL, trivial

    def targets() -> list:
        roots = [trivial("add", f"r{i}", i) for i in range(count // 20)]
        return [trivial("add", f"s{i}", i, {"root": roots[i % len(roots)]}) for i in range(count)]

    with tempfile.TemporaryDirectory() as folder:
        ledger = Ledger(Path(folder))
        started = time.perf_counter()
        ray.init(address="local", num_cpus=2, include_dashboard=False, log_to_driver=False)
        # The first tasks wait for Ray's workers to start.
        run_stages(
            [trivial("add", f"w{i}", -1 - i) for i in range(8)], ledger, Config(), kinds=TRIVIAL
        )
        print(f"Ray ready after {time.perf_counter() - started:.1f} s")
        started = time.perf_counter()
        outcomes = run_stages(targets(), ledger, Config(), kinds=TRIVIAL)
        seconds = time.perf_counter() - started
        assert {outcome.status for outcome in outcomes.values()} == {"ran"}
        print(f"{len(outcomes)} stages: {1000 * seconds / len(outcomes):.2f} ms per stage")
        started = time.perf_counter()
        again = run_stages(targets(), ledger, Config(), kinds=TRIVIAL)
        assert {outcome.status for outcome in again.values()} == {"done"}
        print(f"second call: {time.perf_counter() - started:.2f} s")
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        print(f"driver memory: {peak:.0f} MB")
        ray.shutdown()


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 2000)
