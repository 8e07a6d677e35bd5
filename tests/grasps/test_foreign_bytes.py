"""Any bytes of a grasp file give grasps or one line."""

from __future__ import annotations

import pickle
import pickletools
from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from dmfc.errors import DmfcError
from dmfc.grasps.exchange.hand_map import HandMap, load_hand_map
from dmfc.grasps.exchange.read import FORMATS, read_foreign
from dmfc.grasps.grasp_set import GraspSet
from tests.support.foreign import attempted

ANY = settings(
    max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
HAND_MAPS = {name: load_hand_map(name) for name in FORMATS}
WORLD = b"""<?xml version="1.0"?><world>
<graspableBody><transform><fullTransform>(1 0 0 0)[0 0 0]</fullTransform></transform>
</graspableBody>
<robot><dofValues>0 0 0</dofValues>
<transform><fullTransform>(1 0 0 0)[0 0 100]</fullTransform></transform></robot></world>"""


def saved(folder: Path, content) -> bytes:
    np.save(folder / "good.npy", np.array(content, dtype=object))
    return (folder / "good.npy").read_bytes()


def bench_grasp(**changes):
    qpos = np.concatenate([[0, 0, 0.1, 1, 0, 0, 0], np.full(22, 0.1)])
    return {"obj_pose": qpos[:7], "obj_scale": 0.06, "grasp_qpos": qpos} | changes


def net_grasp(**changes):
    names = ["WRJTx", "WRJTy", "WRJTz", "WRJRx", "WRJRy", "WRJRz"]
    names += list(HAND_MAPS["dexgraspnet"].joints)
    return {"qpos": dict.fromkeys(names, 0.1), "scale": 0.06} | changes


@pytest.fixture(scope="module")
def good(tmp_path_factory) -> dict[str, bytes]:
    folder = tmp_path_factory.mktemp("good")
    return {
        "graspit": WORLD,
        "dexgraspnet": saved(folder, [net_grasp(), net_grasp()]),
        "dexgraspbench": saved(folder, bench_grasp()),
    }


def read(folder: Path, format_name: str, content: bytes) -> None:
    path = folder / f"foreign{FORMATS[format_name]}"
    path.write_bytes(content)
    found, message = attempted(lambda: read_foreign(format_name, [path], HAND_MAPS[format_name]))
    if found is None:
        assert path.name in message
    else:
        assert np.isfinite(found.T).all()
        assert np.isfinite(found.joints).all()
        if format_name == "graspit":  # which has none
            assert np.isnan(found.scales).all()
        else:
            assert (found.scales > 0).all()
        np.testing.assert_allclose(np.linalg.det(found.T), 1, atol=1e-6)


def test_good_files_are_read(tmp_path, good):
    for format_name, content in good.items():
        path = tmp_path / f"good{FORMATS[format_name]}"
        path.write_bytes(content)
        assert len(read_foreign(format_name, [path], load_hand_map(format_name)).joints)


@ANY
@given(format_name=st.sampled_from(sorted(FORMATS)), content=st.binary(max_size=300))
def test_any_bytes(tmp_path, format_name, content):
    read(tmp_path, format_name, content)


@ANY
@given(format_name=st.sampled_from(sorted(FORMATS)), data=st.data())
def test_damaged_files(tmp_path, good, format_name, data):
    content = good[format_name]
    start = data.draw(st.integers(0, len(content)))
    length = data.draw(st.integers(0, 20))
    inserted = data.draw(st.binary(max_size=20))
    read(tmp_path, format_name, content[:start] + inserted + content[start + length :])


VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8)
    | st.binary(max_size=8),
    lambda inner: (
        st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=5), inner, max_size=4)
    ),
    max_leaves=8,
)  # fmt: skip


@ANY
@given(key=st.sampled_from(sorted(bench_grasp())), value=VALUES)
def test_any_value_in_a_grasp_of_dexgraspbench(tmp_path, key, value):
    read(tmp_path, "dexgraspbench", saved(tmp_path, bench_grasp(**{key: value})))


@ANY
@given(key=st.sampled_from(["qpos", "scale", *net_grasp()["qpos"]]), value=VALUES)
def test_any_value_in_a_grasp_of_dexgraspnet(tmp_path, key, value):
    grasp = net_grasp()
    (grasp if key in grasp else grasp["qpos"])[key] = value
    read(tmp_path, "dexgraspnet", saved(tmp_path, [grasp]))


@ANY
@given(value=VALUES)
def test_any_object_array(tmp_path, value):
    for format_name in ("dexgraspnet", "dexgraspbench"):
        content = np.empty(1, dtype=object)
        content[0] = value
        read(tmp_path, format_name, saved(tmp_path, content))


def test_nothing_in_a_pickle_is_run(tmp_path):
    """Every way in which a pickle may call something, in the place of the array."""

    class Calls:
        def __reduce__(self):
            return (Path.write_text, (tmp_path / "ran", "x"))

    header = saved(tmp_path, [1])
    header = header[: header.index(b"\n") + 1]
    for protocol in range(6):
        bad = pickle.dumps(Calls(), protocol)
        assert any(op.name in ("REDUCE", "INST", "OBJ") for op, _, _ in pickletools.genops(bad))
        (tmp_path / "bad.npy").write_bytes(header + bad)
        with pytest.raises(DmfcError, match=r"bad\.npy.*refused|refused"):
            read_foreign("dexgraspbench", [tmp_path / "bad.npy"], load_hand_map("dexgraspbench"))
    assert not (tmp_path / "ran").exists()


MAP = {
    "hand": "shadow",
    "rotation": [1, 0, 0, 0],
    "joints": {"a": {"joint": "rh_FFJ4", "sign": -1}},
}


@ANY
@given(
    content=st.binary(max_size=200)
    | st.builds(
        lambda key, value: yaml.safe_dump(MAP | {key: value}).encode("utf-8", "replace"),
        st.sampled_from(["hand", "position", "rotation", "joints", "other"]),
        VALUES,
    )
)
def test_any_hand_map(tmp_path, content):
    path = tmp_path / "map.yaml"
    path.write_bytes(content)
    found, message = attempted(lambda: load_hand_map(str(path)))
    assert isinstance(found, HandMap) or "map.yaml" in message
    if found is not None:
        assert np.isfinite(found.T_root_palm).all()


def grasp_set(count: int = 3) -> GraspSet:
    rotation = np.tile(np.eye(3), (count, 1, 1))
    position = np.zeros((count, 3))
    return GraspSet(
        object_id="own/a",
        hand="h",
        dof_names=["a", "b"],
        position=position,
        rotation=rotation,
        joints=np.zeros((count, 2)),
        palm_hit=position,
        **dict.fromkeys(("q1", "penetration", "robustness", "contacts"), np.full(count, np.nan)),
    )


@ANY
@given(data=st.data())
def test_any_grasp_set(tmp_path, data):
    path = tmp_path / "set.parquet"
    grasp_set().save(path)
    content = path.read_bytes()
    start = data.draw(st.integers(0, len(content)))
    inserted = data.draw(st.binary(max_size=8))
    length = data.draw(st.integers(0, len(content) - start) | st.just(0))
    path.write_bytes(content[:start] + inserted + content[start + length :])
    found, message = attempted(lambda: GraspSet.load(path))
    assert isinstance(found, GraspSet) or "set.parquet" in message
    if found is not None:
        assert np.isfinite(found.position).all()
        assert np.isfinite(found.rotation).all()
