"""Names of the files that executing the grasps of a shard of test scenes leaves."""

from __future__ import annotations

TRIALS = "trials.parquet"
"""A row per executed grasp."""
DIVERSITY = "diversity.parquet"
"""A row per scene: how different its grasps are."""
