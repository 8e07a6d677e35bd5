"""The hand of the planner's tests."""

from __future__ import annotations

from pathlib import Path

import pytest

from dmfc.hand.description import HandDescription
from dmfc.hand.model import HandModel
from tests.support import grasp_shapes


@pytest.fixture(scope="session")
def hand(shadow_hand_dir: Path) -> HandModel:
    return grasp_shapes.shadow()[0]


@pytest.fixture(scope="session")
def description(hand: HandModel) -> HandDescription:
    return grasp_shapes.shadow()[1]
