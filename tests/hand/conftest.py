"""The Shadow Hand, built once, and its compiled MuJoCo model."""

from __future__ import annotations

from pathlib import Path

import mujoco
import pytest

from dmfc.config.hand import HandConfig
from dmfc.hand.build import build_hand
from dmfc.hand.mjcf import hand_spec, load_description
from dmfc.hand.model import HandModel


@pytest.fixture(scope="session")
def hand(shadow_hand_dir: Path) -> HandModel:
    return build_hand(HandConfig())


@pytest.fixture(scope="session")
def mujoco_model(shadow_hand_dir: Path) -> mujoco.MjModel:
    return hand_spec(load_description("shadow")).compile()
