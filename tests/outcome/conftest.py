"""The hand of the predictor's tests."""

from __future__ import annotations

from pathlib import Path

import pytest

from dmfc.hand.model import HandModel
from tests.support import grasp_shapes


@pytest.fixture(scope="session")
def hand(shadow_hand_dir: Path) -> HandModel:
    return grasp_shapes.shadow()[0]
