"""The Shadow Hand with a block on a table."""

from __future__ import annotations

import pytest

from dmfc.config.physics import PhysicsConfig
from dmfc.hand.description import HandDescription
from dmfc.physics.world import World
from tests.support.physics_shapes import STANDING, block, place, pose


@pytest.fixture(scope="session")
def world(description: HandDescription) -> World:
    """Two blocks and a table; every test resets it."""
    return World(description, [block(), block()], PhysicsConfig(), table_size=2.0)


@pytest.fixture
def still(world: World) -> World:
    """Both blocks stand on the table, the hand is away from them."""
    place(world, [STANDING, pose(-0.4, z=0.06)])
    return world
