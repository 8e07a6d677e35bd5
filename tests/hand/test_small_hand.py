"""A hand of two links written inline: couplings with a ratio, and what is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

from dmfc.config.hand import HandConfig
from dmfc.errors import DmfcError
from dmfc.hand.build import build_hand
from dmfc.hand.kinematics import HandKinematics
from dmfc.hand.mjcf import dof_actuators, hand_spec, load_description

MJCF = """
<mujoco><compiler angle="radian"/><worldbody><body name="palm" pos="0 0 1" quat="0 1 0 0">
  <geom type="box" size=".02 .01 .02"/>
  <body name="near" pos="0 0 .03">
    <joint name="j1" axis="1 0 0" range="0 1.2" limited="true"/>{extra_joint}
    <geom type="capsule" size=".005 .01" pos="0 0 .015"/>{extra_geom}
    <body name="far" pos="0 0 .03"><joint name="j2" axis="{axis}" range="0 0.5" limited="true"/>
      <geom type="cylinder" size=".005 .01" pos="0 0 .01"/></body>
  </body>
</body></worldbody>
<actuator><position name="a1" joint="j1"/></actuator></mujoco>
"""
YAML = """
name: small
mjcf: hand.xml
palm: palm
dofs: {{j1: 0.0}}
couplings: {{j2: {{driver: j1, ratio: 0.5}}}}
inner_points:
  {inner}
"""


def build(folder: Path, inner: str = "far: [[[0, 0, 0.01], [0, -1, 0]]]", **parts: str):
    parts = {"extra_joint": "", "extra_geom": "", "axis": "1 0 0"} | parts
    (folder / "hand.xml").write_text(MJCF.format(**parts))
    (folder / "small.yaml").write_text(YAML.format(inner=inner))
    return build_hand(HandConfig(name=str(folder / "small.yaml"), collision_points=200))


def test_coupling_ratio_and_limits(tmp_path: Path) -> None:
    hand = build(tmp_path)
    assert hand.link_names == ["palm", "near", "far"]
    assert np.array_equal(hand.lower, [0.0])
    # j2 = j1 / 2 <= 0.5 allows j1 <= 1, which is below its own limit.
    assert np.array_equal(hand.upper, [1.0])
    far = HandKinematics(hand).forward(torch.tensor([[0.8]], dtype=torch.float64))[0, 2]
    tip = far @ torch.tensor([0.0, 0.0, 0.02, 1.0], dtype=torch.float64)
    y = -0.03 * np.sin(0.8) - 0.02 * np.sin(1.2)
    z = 0.03 + 0.03 * np.cos(0.8) + 0.02 * np.cos(1.2)
    assert tip[:3].numpy() == pytest.approx([0, y, z], abs=1e-12)
    assert hand.inner_points[0] == pytest.approx([0, -0.005, 0.01], abs=1e-8)
    assert hand.inner_normals[0] == pytest.approx([0, -1, 0], abs=1e-6)


@pytest.mark.parametrize(
    ("parts", "message"),
    [
        ({"inner": "thumb: [[[0, 0, 0], [0, -1, 0]]]"}, "no body 'thumb'"),
        ({"inner": "far: [[[0, 0, 0], [0, -1]]]"}, "must be a list"),
        ({"inner": "far: [[[0.1, 0, 0], [0, -1, 0]]]"}, "misses"),
        ({"inner": "far: []"}, "no inner points"),
        ({"extra_geom": '<geom type="ellipsoid" size=".01 .01 .02"/>'}, "ELLIPSOID"),
    ],
)
def test_what_is_refused(tmp_path: Path, parts: dict[str, str], message: str) -> None:
    with pytest.raises(DmfcError, match=message):
        build(tmp_path, **parts)


def test_joints_that_a_hand_model_cannot_hold(tmp_path: Path) -> None:
    text = MJCF.replace('axis="{axis}"', "{axis}")
    for wrong, message in [
        ('axis="1 0 0" type="slide"', "not a hinge"),
        ('axis="1 0 0" pos="0 0 .01"', "not at its origin"),
    ]:
        (tmp_path / "hand.xml").write_text(text.format(axis=wrong, extra_joint="", extra_geom=""))
        (tmp_path / "small.yaml").write_text(YAML.format(inner="far: [[[0, 0, 0.01], [0, -1, 0]]]"))
        with pytest.raises(DmfcError, match=message):
            build_hand(HandConfig(name=str(tmp_path / "small.yaml")))


def test_actuators_need_no_names(tmp_path: Path) -> None:
    build(tmp_path)
    named = load_description(str(tmp_path / "small.yaml"))
    (expected,) = dof_actuators(hand_spec(named), named)
    assert expected == "hand/a1"
    (tmp_path / "hand.xml").write_text((tmp_path / "hand.xml").read_text().replace('name="a1"', ""))
    spec = hand_spec(named)
    (name,) = dof_actuators(spec, named)
    assert spec.actuator(name).target == "hand/j1"
