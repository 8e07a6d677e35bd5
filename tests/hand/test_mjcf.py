"""The hand in MuJoCo against the file it comes from; descriptions and files that are refused."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from dmfc.errors import DmfcError
from dmfc.hand.description import load_description
from dmfc.hand.mjcf import (
    PREFIX,
    actuator_scale,
    dof_actuators,
    hand_model,
    hand_path,
    hand_spec,
)

MJCF = """
<mujoco><compiler angle="radian"/><worldbody><body name="palm" pos="0 0 1" quat="0 1 0 0">
  <joint name="wrist"/><geom type="box" size=".02 .01 .02"/>
  <body name="near" pos="0 0 .03">
    <joint name="j1" axis="1 0 0" range="0 1.2" limited="true"/>
    <geom type="capsule" size=".005 .01" pos="0 0 .015"/>
    <body name="far" pos="0 0 .03"><joint name="j2" axis="1 0 0" range="0 0.5" limited="true"/>
      <geom type="capsule" size=".005 .01" pos="0 0 .01"/></body>
  </body>
</body></worldbody>
<actuator><position name="a1" joint="j1"/></actuator></mujoco>
"""
YAML = """
name: small
mjcf: hand.xml
palm: palm
dofs: {j1: 0.0}
couplings: {j2: {driver: j1, ratio: 0.5}}
"""


def use(folder: Path, yaml: str = YAML, mjcf: str | None = MJCF) -> mujoco.MjModel:
    """Everything that is done with a description before a simulation begins."""
    (folder / "small.yaml").write_text(yaml)
    if mjcf is not None:
        (folder / "hand.xml").write_text(mjcf)
    description = load_description(str(folder / "small.yaml"))
    dof_actuators(hand_spec(description), description)
    return hand_model(description)


# ── what is kept of the file ─────────────────────────────────────────────────────────────────────


@pytest.fixture(scope="module")
def original(shadow_hand_dir: Path) -> mujoco.MjModel:
    """The file as it is, with forearm and wrist."""
    return mujoco.MjModel.from_xml_path(str(hand_path(load_description("shadow"))))


def test_the_palm_is_the_root_at_the_origin_without_a_joint(mujoco_model: mujoco.MjModel) -> None:
    names = [mujoco_model.body(row).name for row in range(1, mujoco_model.nbody)]
    assert names[0] == PREFIX + "rh_palm"
    assert all(name.startswith(PREFIX) for name in names)
    assert not any("forearm" in name or "wrist" in name for name in names)
    assert mujoco_model.body_jntnum[1] == 0
    assert np.array_equal(mujoco_model.body_pos[1], [0, 0, 0])
    assert np.array_equal(mujoco_model.body_quat[1], [1, 0, 0, 0])
    assert mujoco_model.njnt == 22


def test_bodies_joints_and_geometry_are_those_of_the_file(
    mujoco_model: mujoco.MjModel, original: mujoco.MjModel
) -> None:
    for row in range(1, mujoco_model.nbody):
        ours, theirs = mujoco_model.body(row), original.body(mujoco_model.body(row).name[5:])
        assert ours.mass == pytest.approx(theirs.mass)
        assert ours.inertia == pytest.approx(theirs.inertia)
        if row > 1:
            assert ours.pos == pytest.approx(theirs.pos)
            assert ours.quat == pytest.approx(theirs.quat)
        geoms = [range(b.geomadr[0], b.geomadr[0] + b.geomnum[0]) for b in (ours, theirs)]
        for first, second in zip(*geoms, strict=True):
            assert mujoco_model.geom_type[first] == original.geom_type[second]
            assert mujoco_model.geom_size[first] == pytest.approx(original.geom_size[second])
            assert mujoco_model.geom_pos[first] == pytest.approx(original.geom_pos[second])
            assert mujoco_model.geom_contype[first] == original.geom_contype[second]
    for row in range(mujoco_model.njnt):
        ours = mujoco_model.joint(row)
        theirs = original.joint(ours.name.removeprefix(PREFIX))
        for entry in ("range", "axis", "damping", "armature", "frictionloss", "stiffness"):
            assert getattr(ours, entry) == pytest.approx(getattr(theirs, entry)), (ours.name, entry)


def test_actuators_are_those_of_the_file_in_the_order_of_the_joints(
    shadow_hand_dir: Path, mujoco_model: mujoco.MjModel, original: mujoco.MjModel
) -> None:
    description = load_description("shadow")
    spec = hand_spec(description)
    names, scales = dof_actuators(spec, description), actuator_scale(spec, description)
    assert len(set(names)) == len(names) == 18
    for joint, name, scale in zip(description.dofs, names, scales, strict=True):
        # rh_A_FFJ0 drives J1 and J2 of the first finger together, the others one joint each.
        is_pair = joint[:5] != "rh_TH" and joint.endswith("J2")
        assert name == PREFIX + joint.replace("rh_", "rh_A_").replace(
            "J2" if is_pair else "", "J0" if is_pair else ""
        )
        assert scale == (2.0 if is_pair else 1.0)
        ours, theirs = mujoco_model.actuator(name), original.actuator(name[5:])
        for entry in ("forcerange", "ctrlrange", "gainprm", "biasprm", "gear"):
            assert np.array_equal(getattr(ours, entry), getattr(theirs, entry)), (name, entry)


def test_couplings_become_equalities(tmp_path: Path) -> None:
    model = use(tmp_path)
    assert model.njnt == 2  # the joint of the palm is gone
    assert model.neq == 1
    assert model.eq_type[0] == mujoco.mjtEq.mjEQ_JOINT
    assert model.eq_data[0][:5] == pytest.approx([0, 0.5, 0, 0, 0])
    data = mujoco.MjData(model)
    data.ctrl[0] = 0.8
    model.opt.gravity[:] = 0.0
    model.dof_damping[:] = 0.01
    mujoco.mj_step(model, data, 2000)
    near, far = data.joint(PREFIX + "j1").qpos[0], data.joint(PREFIX + "j2").qpos[0]
    assert near == pytest.approx(0.8, abs=5e-3)
    assert far == pytest.approx(0.5 * near, abs=5e-3)


def test_an_actuator_without_a_limit_gets_that_of_the_description(tmp_path: Path) -> None:
    assert not use(tmp_path).actuator_forcelimited.any()
    model = use(tmp_path, yaml=YAML + "max_torque: 0.5\n")
    assert model.actuator_forcerange.tolist() == [[-0.5, 0.5]]
    assert model.actuator_forcelimited.all()
    own = MJCF.replace('joint="j1"/>', 'joint="j1" forcerange="-2 3"/>')
    model = use(tmp_path, yaml=YAML + "max_torque: 0.5\n", mjcf=own)
    assert model.actuator_forcerange.tolist() == [[-2, 3]]


def test_a_command_is_the_angle_or_the_length_of_the_tendon(tmp_path: Path) -> None:
    use(tmp_path)
    description = load_description(str(tmp_path / "small.yaml"))
    assert np.array_equal(actuator_scale(hand_spec(description), description), [1.0])
    tendon = """<tendon><fixed name="t"><joint joint="j1" coef="2"/><joint joint="j2" coef="3"/>
        </fixed></tendon><actuator><position name="a1" tendon="t"/></actuator>"""
    use(tmp_path, mjcf=MJCF.replace(MJCF[MJCF.index("<actuator>") : -len("</mujoco>\n")], tendon))
    assert np.array_equal(actuator_scale(hand_spec(description), description), [2 + 3 * 0.5])


# ── what is refused ──────────────────────────────────────────────────────────────────────────────


def test_an_unknown_hand_lists_the_hands() -> None:
    with pytest.raises(DmfcError, match=r"unknown hand 'shadwo'; did you mean 'shadow'\?"):
        load_description("shadwo")
    with pytest.raises(DmfcError, match=r"'/nowhere/hand\.yaml' is not a file \(setting hand"):
        load_description("/nowhere/hand.yaml")


@pytest.mark.parametrize(
    ("yaml", "message"),
    [
        (YAML + "colour: red\n", "Key 'colour'"),
        (YAML + "preshape: 3\n", r"\(key preshape\)"),
        (YAML.replace("j1: 0.0", "j1: red"), r"'red'.*\(key dofs.j1\)"),
        (YAML + "x: [1, {\n", "while parsing"),
        ("- a\n- b\n", "incompatible"),
        ("", "missing mandatory value: name"),
        (YAML.replace("mjcf: hand.xml\n", ""), "missing mandatory value: mjcf"),
        (YAML.replace("palm: palm", "palm: plam"), r"no body 'plam' \(key palm\)"),
        (YAML.replace("{j1: 0.0}", "{j1: 0.0, j9: 0.0}"), "'j9' is not in the MJCF"),
        (YAML.replace("couplings: {j2:", "couplings: {j3:"), "joint 'j2' is neither"),
        (YAML.replace("driver: j1", "driver: j7"), r"'j7' has no DoF \(couplings\)"),
        (YAML.replace("ratio: 0.5", "ratio: 0"), "j2.ratio is 0"),
        (YAML + "flexion: {j9: 1.0}\n", "joint in flexion.*'j9'"),
        (YAML + "preshape: {j9: [0, 1]}\n", "joint in preshape.*'j9'"),
        (YAML + "preshape: {j1: [1, 0]}\n", "preshape.j1 is not a range"),
        (YAML + "palm_normal: [0, 0, 0]\n", "palm_normal has no direction"),
    ],
)
def test_descriptions_that_are_refused_on_one_line(tmp_path: Path, yaml: str, message: str) -> None:
    with pytest.raises(DmfcError, match=message) as caught:
        use(tmp_path, yaml=yaml)
    assert "\n" not in str(caught.value)
    assert "small" in str(caught.value)


@pytest.mark.parametrize(
    ("mjcf", "message"),
    [
        (None, r"no MJCF file .*hand\.xml \(key mjcf\)"),
        (MJCF.replace("</mujoco>", ""), "XML"),
        (MJCF.replace('type="box"', 'type="bx"'), "'bx'"),
        (
            MJCF.replace("<worldbody>", '<asset><mesh name="m" file="no.stl"/></asset><worldbody>'),
            "no.stl.*key mjcf",
        ),
        (MJCF.replace('<position name="a1" joint="j1"/>', ""), "no actuator drives 'j1'"),
        (MJCF.replace("<position name", "<motor name"), "'hand/a1' is not a position servo"),
    ],
)
def test_files_that_are_refused_on_one_line(tmp_path: Path, mjcf: str | None, message: str) -> None:
    if mjcf is not None and "no.stl" in mjcf:
        mjcf = mjcf.replace('type="box" size=".02 .01 .02"', 'type="mesh" mesh="m"')
    with pytest.raises(DmfcError, match=message) as caught:
        use(tmp_path, mjcf=mjcf)
    assert "\n" not in str(caught.value)
    assert "small" in str(caught.value)
