"""The Shadow Hand with a block on a table."""

from __future__ import annotations

from pathlib import Path

import pytest

from dmfc.config.physics import PhysicsConfig
from dmfc.hand.description import HandDescription, load_description
from dmfc.physics.world import World
from tests.physics.physics_shapes import block


@pytest.fixture(scope="session")
def description(shadow_hand_dir: Path) -> HandDescription:
    return load_description("shadow")


@pytest.fixture(scope="session")
def world(description: HandDescription) -> World:
    """Two blocks and a table; every test resets it."""
    return World(description, [block(), block()], PhysicsConfig(), table_size=2.0)
