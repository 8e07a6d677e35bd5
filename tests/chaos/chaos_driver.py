"""A driver of a sweep without science, in a process of its own that a test can kill.

python chaos_driver.py STORE SWEEP.yaml RAY_ADDRESS
"""

import sys
from pathlib import Path

from dmfc.engine.ledger import Ledger
from dmfc.experiment.drive import drive
from dmfc.pipeline import kinds
from dmfc.pipeline.graph import GraphBuilder
from dmfc.sweep.planner import plan_sweep
from dmfc.sweep.sweep_file import load_sweep
from tests.chaos.chaos_science import CHAOS, fake_refs


def main(store: str, sweep: str, address: str) -> None:
    """Run the sweep to its end, or until something kills this process."""
    kinds.KINDS.update(CHAOS)  # type: ignore[attr-defined]
    settings = [
        f"run.ray_address={address}", "run.retries=10", "run.tracking_seconds=0.5",
        "run.system_seconds=0.2",
    ]  # fmt: skip
    plan = plan_sweep(load_sweep(sweep), GraphBuilder(fake_refs, CHAOS), "smoke", settings)
    driven = drive([plan], Ledger(Path(store)), as_json=True)
    sys.exit(0 if driven.complete else 1)


if __name__ == "__main__":
    main(*sys.argv[1:])
