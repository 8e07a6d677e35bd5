"""Protocols change execution and nothing else."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest

from dmfc.config.load import load_config
from dmfc.config.protocol import executed
from dmfc.config.shipped import shipped_names
from dmfc.errors import DmfcError


def test_the_default_protocol_is_what_the_settings_say_but_for_the_squeeze() -> None:
    assert set(shipped_names("protocols")) == {"default", "dexgraspbench", "six_directions"}
    config = load_config("quick", ["physics.hand_friction=0.8"])
    squeezed = dataclasses.replace(config.closing, squeeze=0.5)
    assert executed(config) == dataclasses.replace(config, closing=squeezed)


def test_the_peers_published_parameters() -> None:
    config = load_config("quick", ["execution.protocol=dexgraspbench"])
    under = executed(config)
    physics = under.physics
    assert (physics.timestep, physics.impratio, physics.noslip_iterations) == (0.004, 10, 2)
    assert (physics.hand_friction, physics.torsional_friction) == (0.6, 0.02)
    assert (physics.object_mass, physics.hand_weight) == (0.1, False)
    assert (physics.actuator_gain, physics.actuator_limit) == (5, 3)
    assert (under.execution.min_rise, under.execution.max_slip) == (0.1, 0.05)
    assert under.execution.max_turn == pytest.approx(15 * 3.14159 / 180, abs=1e-4)
    assert (under.grasps, under.training) == (config.grasps, config.training)


def test_changes_lie_over_a_protocol_of_ones_own(tmp_path: Path) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text("physics: {timestep: 0.001, hand_friction: 0.3}\n")
    changes = "execution.changes={physics.hand_friction: 0.4}"
    under = executed(load_config("smoke", [f"execution.protocol={path}", changes]))
    assert (under.physics.timestep, under.physics.hand_friction) == (0.001, 0.4)


@pytest.mark.parametrize(
    ("setting", "told"),
    [
        ("execution.changes={training.seed: 1}", "'training.seed' cannot be changed"),
        ("execution.changes={execution.grasps_per_scene: 9}", "grasps_per_scene' cannot be"),
        ("execution.changes={physics.hand_fiction: 1}", "did you mean 'physics.hand_friction'"),
        ("execution.changes={physics.timestep: short}", "physics.timestep"),
        ("execution.protocol=defalt", "did you mean 'default'"),
        ("execution.protocol=paper", "protocol 'paper' is now called 'default'"),
    ],
)
def test_what_is_wrong_is_said_on_one_line(setting: str, told: str) -> None:
    with pytest.raises(DmfcError, match=told) as caught:
        executed(load_config("smoke", [setting]))
    assert "\n" not in str(caught.value)
