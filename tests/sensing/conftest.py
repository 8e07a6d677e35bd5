"""Scenes of a few closed-form objects, and a hand of one paddle."""

from tests.support.scene_fixtures import config, grasps, hand, objects, scenes, shards  # noqa: F401
