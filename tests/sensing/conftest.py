"""Scenes of a few closed-form objects, and a hand of one paddle."""

import pytest

from tests.support import clouds
from tests.support.scene_fixtures import config, grasps, hand, objects, scenes, shards  # noqa: F401


@pytest.fixture(scope="session")
def blob():
    return clouds.blob()
