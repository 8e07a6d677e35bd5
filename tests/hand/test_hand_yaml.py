"""A user's hand file: any bytes give a hand or one line, and angles are those of the joints."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from dmfc.config.hand import HandConfig
from dmfc.errors import DmfcError
from dmfc.hand.build import build_hand
from dmfc.hand.description import HandDescription, custom_hand_digest, load_description
from tests.hand.test_small_hand import MJCF
from tests.support.foreign import attempted

GOOD = {
    "name": "small",
    "mjcf": "hand.xml",
    "palm": "palm",
    "dofs": {"j1": 0.0},
    "couplings": {"j2": {"driver": "j1", "ratio": 0.5}},
    "flexion": {"j1": 1.0},
    "preshape": {"j1": [0.0, 0.5]},
    "inner_points": {"far": [[[0, 0, 0.01], [0, -1, 0]]]},
    "palm_reference": [0.0, 0.0, 0.02],
    "palm_normal": [0.0, 0.0, 1.0],
    "max_torque": 1.0,
}


def written(folder: Path, **changes) -> str:
    (folder / "hand.xml").write_text(MJCF.format(extra_joint="", extra_geom="", axis="1 0 0"))
    (folder / "hand.yaml").write_text(yaml.safe_dump(GOOD | changes))
    return str(folder / "hand.yaml")


def built(name: str):
    return build_hand(HandConfig(name=name, collision_points=100, link_sdf_spacing=0.01))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"dofs": {"j1": 45}}, r"dofs\.j1 is 45 rad.*from 0 to 1 rad; 45 degrees are 0\.7854 rad"),
        ({"dofs": {"j1": -10}}, r"dofs\.j1 is -10 rad.*from 0 to 1 rad$"),
        ({"dofs": {"j1": 1.1}}, r"dofs\.j1 is 1\.1 rad"),
        ({"preshape": {"j1": [0, 30]}}, r"preshape\.j1 is 30 rad.*30 degrees are 0\.5236 rad"),
        ({"preshape": {"j1": [-5, 0.5]}}, r"preshape\.j1 is -5 rad.*from 0 to 1 rad$"),
        ({"preshape": {"j1": [-0.2, 0.5]}}, r"preshape\.j1 is -0\.2 rad.*from 0 to 1 rad"),
    ],
)
def test_angles_outside_the_limits_of_their_joint_are_named(tmp_path, changes, message):
    with pytest.raises(DmfcError, match=message) as raised:
        built(written(tmp_path, **changes))
    assert "\n" not in str(raised.value)


def test_angles_at_the_limits_are_allowed(tmp_path):
    hand = built(written(tmp_path, dofs={"j1": 1.00005}, preshape={"j1": [0.0, 1.0]}))
    assert hand.upper == pytest.approx([1.0])


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"dofs": {"j1": float("nan")}}, r"dofs\.j1 is nan"),
        ({"preshape": {"j1": [0.0, float("inf")]}}, r"preshape\.j1 is inf"),
        ({"flexion": {"j1": float("inf")}}, r"flexion\.j1 is inf"),
        ({"palm_reference": [0, float("nan"), 0]}, "palm_reference is nan"),
        ({"max_torque": float("nan")}, "max_torque is nan"),
        ({"max_torque": -1.0}, "max_torque is -1"),
        ({"palm_normal": [0.0, 0.0, 0.0]}, "palm_normal has no direction"),
        ({"name": ""}, "name is missing"),
        ({"name": "${oc.env:HOME}"}, "is not allowed in settings"),
        ({"dofs": [1, 2]}, "hand.yaml"),
        ({"palm_normal": [0.0, 1.0]}, "length 2"),
        ({"palm_reference": [[], [], []]}, r"palm_reference is \[\]"),
        ({"palm_reference": ["a", "b", "c"]}, "hand.yaml"),
        ({"inner": {}}, "inner"),
    ],
)
def test_values_that_a_hand_cannot_have_are_named(tmp_path, changes, message):
    with pytest.raises(DmfcError, match=message) as raised:
        load_description(written(tmp_path, **changes))
    assert "\n" not in str(raised.value)
    assert "hand.yaml" in str(raised.value)


@pytest.mark.parametrize("key", ["name", "mjcf", "palm"])
def test_a_key_that_is_left_out_is_named(tmp_path, key):
    written(tmp_path)
    content = {name: value for name, value in GOOD.items() if name != key}
    (tmp_path / "hand.yaml").write_text(yaml.safe_dump(content))
    with pytest.raises(DmfcError, match=rf"\b{key}\b"):
        load_description(str(tmp_path / "hand.yaml"))


def read(folder: Path, content: bytes) -> None:
    path = folder / "hand.yaml"
    path.write_bytes(content)
    found, message = attempted(lambda: load_description(str(path)))
    assert isinstance(found, HandDescription) or "hand.yaml" in message
    attempted(lambda: custom_hand_digest(str(path)))


ANY = settings(
    max_examples=100, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    lambda inner: (
        st.lists(inner, max_size=3)
        | st.dictionaries(st.text(max_size=5) | st.just("j1") | st.integers(), inner, max_size=3)
    ),
    max_leaves=6,
)


@ANY
@given(content=st.binary(max_size=200))
def test_any_bytes_are_a_hand_or_one_line(tmp_path, content):
    read(tmp_path, content)


@ANY
@given(key=st.sampled_from([*GOOD, "directory", "pack"]), value=VALUES)
def test_any_value_is_a_hand_or_one_line(tmp_path, key, value):
    read(
        tmp_path, yaml.safe_dump(GOOD | {key: value}, allow_unicode=True).encode("utf-8", "replace")
    )


@ANY
@given(data=st.data())
def test_a_damaged_file_is_a_hand_or_one_line(tmp_path, data):
    content = yaml.safe_dump(GOOD).encode()
    start = data.draw(st.integers(0, len(content)))
    length = data.draw(st.integers(0, 20))
    inserted = data.draw(
        st.binary(max_size=6) | st.sampled_from([b"- ", b": ", b"&a ", b"*a", b"${x}"])
    )
    read(tmp_path, content[:start] + inserted + content[start + length :])
