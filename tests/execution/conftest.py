"""Scenes of planned grasps that the trials execute."""

from __future__ import annotations

import pytest

from dmfc.config.execution import ExecutionConfig
from dmfc.config.physics import PhysicsConfig
from dmfc.execution.evaluate import Evaluation
from dmfc.hand.description import HandDescription
from dmfc.hand.model import HandModel
from dmfc.scenes.scene_set import SceneSet, write_shard
from tests.support.execution_shapes import good, scene_of, standing
from tests.support.grasp_shapes import planned, shape


@pytest.fixture(scope="session")
def scenes(hand: HandModel, tmp_path_factory: pytest.TempPathFactory) -> SceneSet:
    """More labels of one object than are executed; two of two; none."""
    assert len(good("block")) >= ExecutionConfig().grasps_per_scene
    path = tmp_path_factory.mktemp("scenes") / "scenes.parquet"
    made = [
        scene_of(10, ["block"], [standing("block", turn=0.4)], [(0, k) for k in good("block")]),
        scene_of(
            11,
            ["ball", "block"],
            [standing("ball", 0.3), standing("block", -0.3)],
            [(0, 0), (1, 1)],
        ),
        scene_of(12, ["block"], [standing("block")], []),
    ]
    write_shard(path, made, {})
    return SceneSet.open([path])


@pytest.fixture(scope="session")
def planner(hand: HandModel, description: HandDescription, scenes: SceneSet) -> Evaluation:
    objects = {shape(name).id: shape(name) for name in ("block", "ball")}
    return Evaluation(
        source="planner",
        scenes=scenes,
        objects=objects,
        grasps={shape(name).id: planned(name) for name in ("block", "ball")},
        network=None,
        hand=hand,
        description=description,
        physics=PhysicsConfig(),
        config=ExecutionConfig(),
    )
