"""Other projects' grasps mean the same with our hand: against their own kinematics, and MuJoCo."""

from __future__ import annotations

import dataclasses
import json
import re
from pathlib import Path

import mujoco
import numpy as np
import pytest
import torch
import trimesh
from scipy.spatial.transform import Rotation

from dmfc.config.grasps import GraspsConfig
from dmfc.errors import DmfcError
from dmfc.geometry.transforms import apply, inverse, transform
from dmfc.grasps.exchange import dexgraspbench
from dmfc.grasps.exchange.convert import to_grasp_set
from dmfc.grasps.exchange.hand_map import load_hand_map
from dmfc.grasps.exchange.objects_file import load_objects
from dmfc.grasps.exchange.read import in_frame, read_foreign
from dmfc.grasps.grasp_set import GraspSet
from dmfc.hand.kinematics import HandKinematics
from dmfc.hand.mjcf import PREFIX, hand_model
from tests.support import grasp_shapes

COUNT = 5
FINGERS = ["FF", "MF", "RF", "LF", "TH"]


@pytest.fixture(scope="module")
def grasps(hand) -> GraspSet:
    """Any poses beside the block, any joint angles within the limits."""
    model = grasp_shapes.shape("block")
    random = np.random.default_rng(3)
    joints = random.uniform(hand.lower, hand.upper, (COUNT, hand.dofs))
    hit = np.full((COUNT, 3), np.nan)
    pose = random.uniform(-0.1, 0.1, (COUNT, 3)), Rotation.random(COUNT, rng=random).as_matrix()
    unknown = [np.full(COUNT, np.nan)] * 4
    return GraspSet(*pose, joints, model.id, hand.name, list(hand.dof_names), hit, *unknown)


def imported(name, paths, hand, description, **options):
    model = grasp_shapes.shape("block")
    mapped = load_hand_map(name)
    foreign = read_foreign(name, paths, mapped).of_size(options.pop("scale", None), paths[0])
    placed = in_frame(name, foreign, model)
    return to_grasp_set(placed, mapped, hand, description, model, GraspsConfig(), **options)


def link_origins(hand, grasps):
    """Name of a link -> its origin in the object's frame, [n, 3]."""
    T, joints = torch.as_tensor(grasps.T_object_palm), torch.as_tensor(grasps.joints)
    links = HandKinematics(hand).links(T, joints).numpy()
    return {name: links[:, i, :3, 3] for i, name in enumerate(hand.link_names)}


def angle(hand, grasps, joint, row):
    """Angle of a joint by its name without prefix; J1 of a finger follows its J2."""
    if joint in ("FFJ1", "MFJ1", "RFJ1", "LFJ1"):
        joint = joint[:3] + "2"
    return grasps.joints[row, hand.dof_names.index(f"rh_{joint}")]


def same(ours, theirs):
    assert np.allclose(ours.position, theirs.position, atol=1e-9)
    assert np.allclose(ours.rotation, theirs.rotation, atol=1e-9)
    assert np.allclose(ours.joints, theirs.joints, atol=1e-9)


# ── DexGraspBench ────────────────────────────────────────────────────────────────────────────────


@pytest.fixture(scope="module")
def bench(grasps, hand, description, tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("bench")
    mapped, model = load_hand_map("dexgraspbench"), grasp_shapes.shape("block")
    assert dexgraspbench.write(grasps, mapped, hand, description, model, folder) == COUNT
    return folder


def test_dexgraspbench_round_trip(bench, grasps, hand, description):
    found = imported("dexgraspbench", [bench / "grasps"], hand, description)
    same(found, grasps)
    assert float(found.notes["coupling_error"]) == 0
    assert np.isnan(found.q1).all()


def test_dexgraspbench_files_are_what_its_evaluator_reads(bench, grasps, hand, description):
    """The hand's links, placed by MuJoCo from a file, are where our kinematics has them."""
    model = hand_model(description)
    data = mujoco.MjData(model)
    names = [
        f"{f}J{k}" for f in FINGERS for k in ((5, 4, 3, 2, 1) if f in "LFTH" else (4, 3, 2, 1))
    ]
    expected = link_origins(hand, grasps)
    for row in range(COUNT):
        file = next((bench / "grasps").rglob(f"{row}.npy"))
        grasp = np.load(file, allow_pickle=True).item()
        assert grasp["grasp_qpos"].shape == (29,)
        for name, value in zip(names, grasp["grasp_qpos"][7:], strict=True):
            data.qpos[model.joint(f"{PREFIX}rh_{name}").qposadr] = value
        mujoco.mj_kinematics(model, data)
        root = transform(
            Rotation.from_quat(grasp["grasp_qpos"][3:7], scalar_first=True).as_matrix(),
            grasp["grasp_qpos"][:3],
        )
        T_root_palm = np.eye(4)
        T_root_palm[2, 3] = 0.034
        for link, origins in expected.items():
            local = data.body(PREFIX + link).xpos - data.body(f"{PREFIX}rh_palm").xpos
            turn = data.body(f"{PREFIX}rh_palm").xmat.reshape(3, 3)
            placed = apply(root @ T_root_palm, (local @ turn)[None])[0]
            assert np.allclose(placed, origins[row], atol=1e-9), link
        opened, squeezed = grasp["pregrasp_qpos"][7:], grasp["squeeze_qpos"][7:]
        flexed = names.index("FFJ3")
        assert opened[flexed] <= grasp["grasp_qpos"][7 + flexed] <= squeezed[flexed]
    info = json.loads(next(bench.rglob("simplified.json")).read_text())
    parts = [trimesh.load(p, process=False) for p in bench.rglob("convex_piece_*.obj")]
    volume = info["mass"] / info["density"] * (grasp["obj_scale"] / info["scale"]) ** 3
    assert volume == pytest.approx(np.prod(grasp_shapes.BLOCK_SIZE), rel=1e-4)
    assert np.linalg.norm(np.ptp(parts[0].vertices, axis=0)) == pytest.approx(2, rel=1e-4)


def test_coupled_joints_that_differ_meet_half_way(bench, grasps, hand, description, tmp_path):
    grasp = load_objects(next((bench / "grasps").rglob("0.npy")))[0]
    grasp["grasp_qpos"][7 + 2] = 1.0  # FFJ2
    grasp["grasp_qpos"][7 + 3] = 0.4  # FFJ1
    np.save(tmp_path / "0.npy", np.array(grasp, dtype=object))
    found = imported("dexgraspbench", [tmp_path], hand, description)
    assert angle(hand, found, "FFJ2", 0) == pytest.approx(0.7)
    assert found.notes["coupling_error"] == "0.3000"


def test_another_size_is_refused(bench, hand, description, tmp_path):
    grasp = load_objects(next((bench / "grasps").rglob("0.npy")))[0]
    np.save(tmp_path / "0.npy", np.array({**grasp, "obj_scale": 0.3}, dtype=object))
    with pytest.raises(DmfcError, match=r"0\.npy: obj_scale 0\.3000, but half the diagonal"):
        imported("dexgraspbench", [tmp_path], hand, description)


def changed_grasp(bench, folder, **changes):
    grasp = load_objects(next((bench / "grasps").rglob("0.npy")))[0]
    np.save(folder / "0.npy", np.array({**grasp, **changes}, dtype=object))
    return folder


QPOS = np.concatenate([[0, 0, 0.1, 1, 0, 0, 0], np.full(22, 0.1)])


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"grasp_qpos": np.where(np.arange(29) == 3, 0, QPOS)},
            "quaternion of a pose has length 0",
        ),
        ({"obj_pose": np.zeros(7)}, "has length 0, not 1"),
        ({"obj_pose": np.array([0, 0, 0, 0.7, 0, 0, 0.1])[:6]}, "obj_pose must be 7 finite"),
        ({"grasp_qpos": np.where(np.arange(29) == 9, np.nan, QPOS)}, "grasp_qpos must be finite"),
        ({"grasp_qpos": np.where(np.arange(29) == 0, np.inf, QPOS)}, "grasp_qpos must be finite"),
        ({"grasp_qpos": QPOS[:5]}, "grasp_qpos has 5 numbers"),
        ({"grasp_qpos": None}, "grasp_qpos"),
        ({"grasp_qpos": "abc"}, "grasp_qpos"),
        ({"obj_scale": 0.0}, "obj_scale is 0, not a size"),
        ({"obj_scale": -0.06}, "obj_scale is -0.06"),
        ({"obj_scale": float("nan")}, "obj_scale must be"),
        ({"obj_scale": "large"}, "obj_scale"),
        ({"obj_scale": None}, "obj_scale"),
    ],
)
def test_numbers_that_a_grasp_cannot_have_are_named(
    bench, hand, description, tmp_path, changes, message
):
    folder = changed_grasp(bench, tmp_path, **changes)
    with pytest.raises(DmfcError, match=rf"0\.npy: .*{message}") as raised:
        imported("dexgraspbench", [folder], hand, description)
    assert "\n" not in str(raised.value)


def block_scale(factor=1.0):
    return factor * float(np.linalg.norm(grasp_shapes.BLOCK_SIZE)) / 2


@pytest.mark.parametrize(("factor", "refused"), [(1.016, False), (0.97, True), (1.05, True)])
def test_meshes_a_little_over_the_stated_size_are_taken(
    bench, grasps, hand, description, tmp_path, factor, refused
):
    """DexGraspBench's bottle and can are 1.016 times as large as stated."""
    folder = changed_grasp(bench, tmp_path, obj_scale=block_scale(1 / factor))
    if refused:
        with pytest.raises(DmfcError, match="another object or size"):
            imported("dexgraspbench", [folder], hand, description)
    else:
        same(imported("dexgraspbench", [folder], hand, description), grasps[:1])


def test_the_frame_is_that_of_their_mesh(bench, grasps, hand, description, tmp_path):
    """Their simplified meshes do not lie exactly about the origin; a mesh of another source does
    not have their origin, but its box has their centre."""
    folder = changed_grasp(bench, tmp_path)
    foreign = read_foreign("dexgraspbench", [folder], load_hand_map("dexgraspbench"))
    shift = np.array([0.0005, -0.0003, 0.0004])
    block = grasp_shapes.shape("block")
    other = dataclasses.replace(block, vertices=block.vertices + shift, source="ycb")
    theirs = dataclasses.replace(other, source="folder")
    away = dataclasses.replace(theirs, vertices=block.vertices + 100 * shift)

    def origin(model):
        return in_frame("dexgraspbench", foreign, model).T[0, :3, 3]

    np.testing.assert_allclose(origin(theirs), foreign.T[0, :3, 3], atol=1e-12)
    np.testing.assert_allclose(origin(other) - origin(theirs), shift, atol=1e-12)
    np.testing.assert_allclose(origin(away) - origin(theirs), 100 * shift, atol=1e-12)


# ── DexGraspNet ──────────────────────────────────────────────────────────────────────────────────

# Its hand's MJCF: per joint (counted from 1, as ours) the offset from the one before and the axis.
NET_FINGER = [(4, (0, 1, 0)), (3, (1, 0, 0)), (2, (1, 0, 0)), (1, (1, 0, 0))]
NET_LENGTHS = {3: 0.0, 2: 0.045, 1: 0.025}
NET_KNUCKLES = {"FF": (0.033, 0, 0.095), "MF": (0.011, 0, 0.099), "RF": (-0.011, 0, 0.095)}
NET_THUMB = [
    (5, 0.0, (0, 0, -1)),
    (4, 0.0, (1, 0, 0)),
    (3, 0.038, (1, 0, 0)),
    (2, 0.0, (0, 1, 0)),
    (1, 0.032, (0, 1, 0)),
]


def turned(axis, value):
    return transform(Rotation.from_rotvec(np.array(axis) * value).as_matrix(), np.zeros(3))


def shifted(*offset):
    return transform(np.eye(3), np.array(offset, dtype=float))


def net_tips(T_root, qpos):
    """The points 2 cm beyond each last joint, by DexGraspNet's own chain."""
    tips = {}
    for finger, knuckle in NET_KNUCKLES.items():
        T = T_root @ shifted(*knuckle)
        for joint, axis in NET_FINGER:
            T = T @ shifted(0, 0, NET_LENGTHS.get(joint, 0.0))
            T = T @ turned(axis, qpos[f"robot0:{finger}J{joint - 1}"])
        tips[finger] = (T @ [0, 0, 0.02, 1])[:3]
    base = transform(
        Rotation.from_quat([0.923956, 0, 0.382499, 0], scalar_first=True).as_matrix(),
        np.array([0.034, -0.009, 0.029]),
    )
    T = T_root @ base
    for joint, length, axis in NET_THUMB:
        T = T @ shifted(0, 0, length) @ turned(axis, qpos[f"robot0:THJ{joint - 1}"])
    tips["TH"] = (T @ [0, 0, 0.02, 1])[:3]
    return tips


@pytest.fixture(scope="module")
def net_rows(grasps, hand):
    """The grasps as DexGraspNet would write them."""
    opposite = {"FFJ4", "MFJ4", "THJ2", "THJ1"}
    rows = []
    for row in range(COUNT):
        qpos = dict(zip(("WRJTx", "WRJTy", "WRJTz"), grasps.position[row], strict=True))
        euler = Rotation.from_matrix(grasps.rotation[row]).as_euler("xyz")
        qpos |= dict(zip(("WRJRx", "WRJRy", "WRJRz"), euler, strict=True))
        for finger in FINGERS:
            for k in (5, 4, 3, 2, 1) if finger in ("LF", "TH") else (4, 3, 2, 1):
                value = angle(hand, grasps, f"{finger}J{k}", row)
                sign = -1 if f"{finger}J{k}" in opposite else 1
                qpos[f"robot0:{finger}J{k - 1}"] = float(sign * value)
        rows.append({"qpos": qpos, "scale": 0.08 if row < 4 else 0.1})
    return rows


def test_dexgraspnet_means_the_same_with_our_hand(net_rows, grasps, hand, description, tmp_path):
    np.save(tmp_path / "mug.npy", np.array(net_rows, dtype=object))
    found = imported("dexgraspnet", [tmp_path / "mug.npy"], hand, description, scale=0.08)
    same(found, grasps[:4])
    origins = {}
    T, joints = torch.as_tensor(found.T_object_palm), torch.as_tensor(found.joints)
    links = HandKinematics(hand).links(T, joints).numpy()
    for finger in ("FF", "MF", "RF", "TH"):
        last = links[:, hand.link_names.index(f"rh_{finger.lower()}distal")]
        origins[finger] = last[:, :3, 3] + 0.02 * last[:, :3, 2]
    for row in range(4):
        for finger, tip in net_tips(found.T_object_palm[row], net_rows[row]["qpos"]).items():
            assert np.linalg.norm(tip - origins[finger][row]) < 0.0015, finger  # the hands differ


def test_sizes_are_not_mixed(net_rows, hand, description, tmp_path):
    np.save(tmp_path / "mug.npy", np.array(net_rows, dtype=object))
    with pytest.raises(DmfcError, match=r"several sizes of the object \(0\.08, 0\.1\).*--scale"):
        imported("dexgraspnet", [tmp_path], hand, description)
    with pytest.raises(DmfcError, match=r"no grasp for --scale 0\.2"):
        imported("dexgraspnet", [tmp_path], hand, description, scale=0.2)


def test_a_grasp_with_a_joint_out_of_its_limits_is_skipped(
    net_rows, grasps, hand, description, tmp_path
):
    """And counted; where no other is left, it is named."""
    far = {**net_rows[1], "qpos": {**net_rows[1]["qpos"], "robot0:THJ3": 1.5}}
    np.save(tmp_path / "mug.npy", np.array([net_rows[0], far, net_rows[2], far], dtype=object))
    found = imported("dexgraspnet", [tmp_path], hand, description)
    same(found, grasps[np.array([0, 2])])
    assert (found.notes["skipped"], found.notes["imported"]) == ("2", "2")
    np.save(tmp_path / "mug.npy", np.array([net_rows[0], far], dtype=object))
    found = imported("dexgraspnet", [tmp_path], hand, description, tolerance=0.3)
    assert "skipped" not in found.notes
    assert angle(hand, found, "THJ4", 1) == pytest.approx(
        hand.upper[hand.dof_names.index("rh_THJ4")]
    )
    np.save(tmp_path / "mug.npy", np.array([far], dtype=object))
    with pytest.raises(DmfcError, match=r"mug\.npy#0: joint rh_THJ4 at 1\.500 .*--tolerance"):
        imported("dexgraspnet", [tmp_path], hand, description)


@pytest.mark.parametrize("factor", [0.5, 0.75, 1.3, 2.0])
def test_a_mesh_of_another_size_is_refused(net_rows, hand, description, tmp_path, factor):
    """The block reaches 0.0716 m from its origin, as one of scale 0.08 may."""
    other = [{**row, "scale": 0.0716 * factor} for row in net_rows]
    np.save(tmp_path / "mug.npy", np.array(other, dtype=object))
    with pytest.raises(DmfcError, match=r"mug\.npy#0: scale .* reaches 0\.07159 m.*another object"):
        imported("dexgraspnet", [tmp_path], hand, description)


def test_grasps_out_of_reach_are_of_another_object(net_rows, hand, description, tmp_path):
    far = [{**row, "qpos": {**row["qpos"], "WRJTx": 0.6}} for row in net_rows[:4]]
    np.save(tmp_path / "mug.npy", np.array(far, dtype=object))
    with pytest.raises(DmfcError, match=r"mug\.npy#\d: the palm is 0\.\d+ m from .*another object"):
        imported("dexgraspnet", [tmp_path], hand, description)
    far[3] = net_rows[3]
    np.save(tmp_path / "mug.npy", np.array([far[0], *net_rows[:3]], dtype=object))
    assert len(imported("dexgraspnet", [tmp_path], hand, description)) == 4  # one of them is astray


def test_another_hand_is_refused(net_rows, hand, description, tmp_path):
    """A file without a joint of ours, and our side set to another hand."""
    short = {**net_rows[0], "qpos": {k: v for k, v in net_rows[0]["qpos"].items() if "LF" not in k}}
    np.save(tmp_path / "mug.npy", np.array([short], dtype=object))
    with pytest.raises(DmfcError, match=r"no angle of 'robot0:LFJ4'.*another hand"):
        imported("dexgraspnet", [tmp_path], hand, description)
    with pytest.raises(DmfcError, match=r"of the hand 'shadow', not of 'claw'"):
        load_hand_map("dexgraspnet").matrix(dataclasses.replace(description, name="claw"))
    with pytest.raises(DmfcError, match=r"unknown format 'dexgrasnet'; did you mean 'dexgraspnet'"):
        load_hand_map("dexgrasnet")


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"scale": 0}, "scale is 0, not a size"),
        ({"scale": None}, "scale"),
        ({"scale": [0.06, 0.08]}, "scale must be 1 finite"),
        ({"qpos": {"WRJTx": float("nan")}}, "qpos must be 28 finite numbers"),
        ({"qpos": {"WRJRx": "x"}}, "qpos is not a row of numbers"),
        ({"qpos": {"robot0:FFJ0": [1, 2]}}, "qpos is not a row of numbers"),
        ({"qpos": {"robot0:FFJ0": None}}, "qpos"),
    ],
)
def test_numbers_that_a_row_cannot_have_are_named(
    net_rows, hand, description, tmp_path, changes, message
):
    qpos = {**net_rows[0]["qpos"], **changes.get("qpos", {})}
    np.save(
        tmp_path / "mug.npy", np.array([{**net_rows[0], **changes, "qpos": qpos}], dtype=object)
    )
    with pytest.raises(DmfcError, match=rf"mug\.npy#0: {message}"):
        imported("dexgraspnet", [tmp_path], hand, description)


# ── GraspIt! ─────────────────────────────────────────────────────────────────────────────────────

GRASPIT_DOFS = [f"LFJ{k}" for k in (5, 4, 3, 2)]
GRASPIT_DOFS += [f"{f}J{k}" for f in ("RF", "MF", "FF") for k in (4, 3, 2)]
GRASPIT_DOFS += [f"THJ{k}" for k in (5, 4, 3, 2, 1)]
WORLD = """<?xml version="1.0" ?>
<world>
    <graspableBody>
        <filename>models/objects/mug.xml</filename>
        <transform><fullTransform>({body})[{body_mm}]</fullTransform></transform>
    </graspableBody>
    <robot>
        <filename>models/robots/ShadowHand/ShadowHand.xml</filename>
        <dofValues>{dofs}</dofValues>
        <transform><fullTransform>({robot})[{robot_mm}]</fullTransform></transform>
    </robot>
    <camera><position>0 0 0</position></camera>
</world>
"""


def signed(values):
    return " ".join(f"{value:+.17g}" for value in values)


def world(T_world_object, T_object_root, dofs):
    def parts(T):
        quaternion = Rotation.from_matrix(T[:3, :3]).as_quat(scalar_first=True)
        return signed(quaternion), signed(1000 * T[:3, 3])

    body, robot = parts(T_world_object), parts(T_world_object @ T_object_root)
    return WORLD.format(
        body=body[0], body_mm=body[1], robot=robot[0], robot_mm=robot[1], dofs=signed(dofs)
    )


@pytest.fixture
def worlds(grasps, hand, tmp_path) -> Path:
    T_palm_root = inverse(load_hand_map("graspit").T_root_palm)
    T_world_object = transform(Rotation.from_rotvec([0.3, -1, 2]).as_matrix(), np.ones(3))
    for row in range(COUNT):
        dofs = [angle(hand, grasps, name, row) for name in GRASPIT_DOFS]
        text = world(T_world_object, grasps.T_object_palm[row] @ T_palm_root, dofs)
        (tmp_path / f"grasp{row}.xml").write_text(text)
    return tmp_path


def test_graspit_round_trip(worlds, grasps, hand, description):
    same(imported("graspit", [worlds], hand, description), grasps)


def test_graspit_knuckles_are_ours(hand, description, tmp_path):
    """The middle joint of first and middle finger, by the Denavit-Hartenberg rows of its robot
    file (mm): a = 0, alpha = 90 for the knuckle, a = 45 for the next."""
    knuckles = {"FF": (91, -44, 2), "MF": (95, -22, 1)}
    names = {
        f"{f}J{k}": v for f, k, v in (("FF", 4, 0), ("FF", 3, 0.9), ("MF", 4, 0), ("MF", 3, 0.3))
    }
    dofs = [names.get(name, 0.0) for name in GRASPIT_DOFS]
    (tmp_path / "a.xml").write_text(world(np.eye(4), np.eye(4), dofs))
    found = imported("graspit", [tmp_path / "a.xml"], hand, description)
    origins = link_origins(hand, found)
    for finger, knuckle in knuckles.items():
        flexion = names[f"{finger}J3"]
        expected = np.array(knuckle) + 45 * np.array([np.cos(flexion), 0, np.sin(flexion)])
        ours = 1000 * origins[f"rh_{finger.lower()}middle"][0]
        assert np.linalg.norm(ours - expected) < 1.6


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda t: t.replace("<dofValues>", "<dofValues>0 "), "dofValues, but .* has 18"),
        (lambda t: t.replace("<robot>", "<robot/><robot>"), "2 <robot> in this world"),
        (lambda t: t.replace("[", "{"), "no fullTransform"),
        (lambda t: re.sub(r"Transform>\([^)]*", "Transform>(0 0 0 0", t), "has length 0, not 1"),
        (lambda t: re.sub(r"Transform>\([^)]*", "Transform>(nan 0 0 0", t), "finite numbers"),
        (lambda t: re.sub(r"\[[^ ]*", "[inf", t), "finite numbers"),
        (lambda t: t[:300], "not XML"),
        (lambda t: t.replace("<world>", "<!DOCTYPE w><world>"), "declares a document type"),
    ],
)
def test_other_worlds_are_refused(worlds, hand, description, change, message):
    file = worlds / "grasp4.xml"
    file.write_text(change(file.read_text()))
    with pytest.raises(DmfcError, match=message):
        imported("graspit", [worlds], hand, description)


def test_another_number_of_joints_is_another_hand(worlds, hand, description):
    for file in worlds.glob("*.xml"):
        file.write_text(file.read_text().replace("<dofValues>", "<dofValues>0 0 "))
    with pytest.raises(DmfcError, match=r"20 joint angles, .* 'shadow' has 18"):
        imported("graspit", [worlds], hand, description)
