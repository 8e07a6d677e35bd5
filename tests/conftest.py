"""Fixtures that several parts use."""

from __future__ import annotations

from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def shadow_hand_dir() -> Path:
    """Folder of the Shadow Hand's MJCF: the pinned pack, downloaded once into the cache."""
    from dmfc.assets import pull

    return pull("shadow_hand")
