"""Trial rows do not depend on how many workers made them, nor on those that died over them."""

import shutil

import pandas as pd
import pytest

from dmfc.config.load import load_config
from dmfc.engine.engine import run_stages
from dmfc.engine.ledger import Ledger
from dmfc.execution.evaluate import DIVERSITY, TRIALS
from dmfc.pipeline.graph import GraphBuilder
from dmfc.pipeline.kinds import KINDS
from dmfc.pipeline.selection import list_refs
from tests.support.dying_stages import DYING, killed_mark

SETTINGS = [
    "objects.test=[procedural/can-0005, procedural/ball-0003]",
    "grasps.source=library",
    "scenes.test={kind: single, count: 4}",
    "scenes.shard_size=2",
    "execution.grasps_per_scene=2",
]


@pytest.mark.full
def test_rows_of_one_worker_and_of_two_that_are_killed(tmp_path, shadow_hand_dir, ray_cluster):
    config = load_config("smoke", SETTINGS)
    shards = GraphBuilder(list_refs).cell(config, "planner", "planner", None).evaluations
    assert len(shards) == 2
    one, two = Ledger(tmp_path / "one"), Ledger(tmp_path / "two")
    calm = run_stages(shards, one, config, KINDS, local=True)
    assert {outcome.status for outcome in calm.values()} == {"ran"}
    two.prepare()
    shutil.copytree(
        one.store / "stages",
        two.store / "stages",
        ignore=shutil.ignore_patterns("evaluate"),
        dirs_exist_ok=True,
    )
    outcomes = run_stages(shards, two, config, kinds=DYING)
    held = 0
    for shard in shards:
        assert outcomes[shard.address].status == "ran"
        assert killed_mark(two.work(shard.address)).exists()
        for name in (TRIALS, DIVERSITY):
            rows, expected = (
                pd.read_parquet(ledger.folder(shard.address) / name) for ledger in (two, one)
            )
            pd.testing.assert_frame_equal(rows, expected, check_exact=True)
        held += pd.read_parquet(one.folder(shard.address) / TRIALS)["held"].sum()
    assert held >= 4
