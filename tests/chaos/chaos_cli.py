"""`dmfc ...` with the stages of `chaos_science`, in a process of its own."""

import os

from dmfc.cli.main import main
from dmfc.engine import ray_cluster
from dmfc.pipeline import kinds, selection
from tests.chaos.chaos_science import CHAOS, fake_refs

if __name__ == "__main__":
    kinds.KINDS.update(CHAOS)  # type: ignore[attr-defined]
    selection.list_refs = fake_refs
    ray_cluster.HEAD_SECONDS = float(os.environ.get("HEAD_SECONDS", ray_cluster.HEAD_SECONDS))
    main()
