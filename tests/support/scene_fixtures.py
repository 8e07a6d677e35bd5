"""Objects, grasps and a hand that the tests of scenes share."""

from __future__ import annotations

from pathlib import Path

import pytest

from dmfc.config.scenes import ScenesConfig, SceneSetConfig
from dmfc.grasps.grasp_set import GraspSet
from dmfc.hand.model import HandModel
from dmfc.objects.model import ObjectModel
from dmfc.scenes.make import SceneMaker, make_scene_file
from dmfc.scenes.scene_set import Scene
from tests.support import scene_shapes


@pytest.fixture(scope="session")
def objects() -> dict[str, ObjectModel]:
    return scene_shapes.shapes()


@pytest.fixture(scope="session")
def grasps(objects: dict[str, ObjectModel]) -> dict[str, GraspSet]:
    return {name: scene_shapes.grasps_around(model, 80) for name, model in objects.items()}


@pytest.fixture(scope="session")
def hand() -> HandModel:
    return scene_shapes.paddle()


@pytest.fixture(scope="session")
def config() -> ScenesConfig:
    return ScenesConfig(train=SceneSetConfig(kind="multi", count=7), shard_size=3)


@pytest.fixture(scope="session")
def shards(
    tmp_path_factory: pytest.TempPathFactory,
    config: ScenesConfig,
    objects: dict[str, ObjectModel],
    grasps: dict[str, GraspSet],
    hand: HandModel,
) -> list[Path]:
    """The seven scenes in three shards."""
    folder = tmp_path_factory.mktemp("shards")
    paths = []
    for numbers in (range(3), range(3, 6), range(6, 7)):
        paths.append(folder / f"{len(paths)}.parquet")
        make_scene_file(config, config.train, numbers, objects, grasps, hand, paths[-1])
    return paths


@pytest.fixture(scope="session")
def scenes(
    config: ScenesConfig,
    objects: dict[str, ObjectModel],
    grasps: dict[str, GraspSet],
    hand: HandModel,
) -> list[Scene]:
    """The seven multi-object scenes of `config`."""
    with SceneMaker(config, config.train, objects, grasps, hand) as maker:
        return [maker.make(number) for number in range(7)]
