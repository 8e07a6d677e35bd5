"""A sweep without science in a process of its own, each stage of which waits for a test.

python -m tests.chaos.power_cut_driver STORE SWEEP.yaml GATES: stage n begins when GATES/n is there,
and has ended when GATES/n.done is.
"""

import sys
import time
from pathlib import Path

import pytest

from dmfc.engine import pools
from dmfc.engine.ledger import Ledger
from dmfc.engine.state import driving, write_state
from tests.support.alone import made, patch_science, planned

execute = pools.execute


def main(store: Path, sweep: Path, gates: Path) -> int:
    """Run the sweep to its end."""
    begun = iter(range(10**6))

    def gated(job, **options):
        number = next(begun)
        while not (gates / str(number)).exists():
            time.sleep(0.01)
        found = execute(job, **options)
        (gates / f"{number}.done").touch()
        return found

    with pytest.MonkeyPatch.context() as patch:
        patch_science(patch)
        patch.setattr(pools, "execute", gated)
        plan = planned(sweep, sweep.read_text())
        folder = plan.write(Ledger(store))
        with driving([folder]):
            write_state(folder, "RUNNING", {})
            told = made(plan, store)
            write_state(folder, "FINISHED", {})
    return len(told)


if __name__ == "__main__":
    sys.exit(main(*map(Path, sys.argv[1:])))
