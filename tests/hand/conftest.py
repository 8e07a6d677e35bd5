"""The compiled MuJoCo model of the Shadow Hand."""

from __future__ import annotations

from pathlib import Path

import mujoco
import pytest

from dmfc.hand.mjcf import hand_spec, load_description


@pytest.fixture(scope="session")
def mujoco_model(shadow_hand_dir: Path) -> mujoco.MjModel:
    return hand_spec(load_description("shadow")).compile()
