"""The planner against the network itself, and what must not change its answer."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

import dmfc
from dmfc.config.execution import ExecutionConfig
from dmfc.config.hand import HandConfig
from dmfc.errors import DmfcError
from dmfc.grasps.grasp_set import GraspSet
from dmfc.hand.build import build_hand
from dmfc.network.checkpoint import load_alone
from dmfc.prediction.cloud_check import CloudCheck
from dmfc.prediction.planner import load, upright
from tests.prediction.conftest import LIMIT
from tests.support import clouds
from tests.support.toy import SEEDS


@pytest.fixture(scope="module")
def planner(stage_folder):
    return load(stage_folder)


def same(a, b, atol=1e-5):
    np.testing.assert_allclose(a.T_cloud_palm, b.T_cloud_palm, atol=atol)
    np.testing.assert_allclose(a.joints, b.joints, atol=atol)
    np.testing.assert_allclose(a.confidence, b.confidence, atol=atol)


def test_it_answers_what_the_network_says(planner, stage_folder, blob):
    """Of exactly as many points as it is given, the network's own answer at each."""
    points = blob[:2048]
    grasps = planner(points)
    net, hand = load_alone(stage_folder)
    order = np.random.default_rng(0).choice(2048, 2048, replace=False)
    with torch.inference_mode():
        found = net(torch.tensor(points[order], dtype=torch.float32)[None])
    rank = np.argsort(-found.confidence[0].numpy(), kind="stable")
    assert hand == grasps.hand == "shadow"
    np.testing.assert_allclose(grasps.confidence, found.confidence[0].numpy()[rank], atol=1e-6)
    np.testing.assert_allclose(
        grasps.T_cloud_palm[:, :3, 3], found.position[0].numpy()[rank], atol=1e-6
    )
    joints = np.clip(found.joints[0].numpy()[rank], -LIMIT, LIMIT)
    np.testing.assert_allclose(grasps.joints, joints, atol=1e-6)
    np.testing.assert_array_equal(grasps.point, order[found.seed_index[0].numpy()[rank]])


def test_what_points_or_table_are_in_the_way_of_is_left_out(planner, blob):
    """The table is under the lowest point, wherever the cloud lies and whichever way is up."""
    points = blob[:2048]
    grasps = planner(points)
    T, height = grasps.T_cloud_palm.copy(), np.array([0, 0, points[:, 2].min()])
    T[:, :3, 3] -= height
    check = CloudCheck(build_hand(HandConfig()), ExecutionConfig())
    clear = check.clear(T, grasps.joints, points - height)
    assert 0 < clear.sum() < len(grasps)
    same(planner(points, check=True), grasps[clear])
    turn = Rotation.from_euler("x", 90, degrees=True).as_matrix()
    turned = planner(points @ turn.T + [0.2, 0.1, 0.5], up=turn[:, 2], check=True)
    np.testing.assert_array_equal(turned.point, grasps.point[clear])


def test_grasps_are_ranked_poses_within_limits(planner, blob):
    grasps = planner(blob)
    assert len(grasps) == SEEDS
    assert (np.diff(grasps.confidence) <= 0).all()
    assert np.ptp(grasps.confidence) > 0.02
    assert Rotation.from_matrix(grasps.T_cloud_palm[:, :3, :3]).magnitude().max() > 0.1
    turned = grasps.T_cloud_palm[:, :3, :3]
    np.testing.assert_allclose(turned @ turned.mT, np.tile(np.eye(3), (SEEDS, 1, 1)), atol=1e-5)
    assert np.abs(grasps.joints).max() <= LIMIT
    assert len(grasps.dof_names) == grasps.joints.shape[1] == 18


def test_the_same_cloud_gives_the_same_grasps_with_and_without_compiled_loops(
    planner, stage_folder, blob
):
    first = planner(blob)
    np.testing.assert_array_equal(first.T_cloud_palm, planner(blob.copy()).T_cloud_palm)
    same(first, load(stage_folder, compiled=False)(blob))


@pytest.mark.parametrize("unit", ["mm", "cm"])
def test_units(planner, blob, unit):
    scale = {"mm": 1000, "cm": 100}[unit]
    same(planner(blob), planner(blob * scale, unit=unit), atol=1e-5)


def test_a_cloud_in_the_coordinates_of_a_map_has_the_same_grasps(planner, blob):
    offset = np.array([5.4e6, 3.2e5, 412.0])
    far, near = planner(blob + offset), planner(blob)
    np.testing.assert_array_equal(far.point, near.point)
    np.testing.assert_allclose(far.joints, near.joints, atol=1e-5)
    moved = far.T_cloud_palm.copy()
    moved[:, :3, 3] -= offset
    np.testing.assert_allclose(moved, near.T_cloud_palm, atol=1e-5)
    up = (0.2, -0.9, 0.3)
    moved = planner(blob + offset, up=up).T_cloud_palm
    moved[:, :3, 3] -= offset
    np.testing.assert_allclose(moved, planner(blob, up=up).T_cloud_palm, atol=1e-5)


def test_up_turns_the_answer_with_the_cloud(planner, blob):
    up = np.array([0.2, -0.9, 0.3])
    R_scene_cloud = upright(up)
    turned = planner(blob @ R_scene_cloud, up=tuple(up))
    plain = planner(blob)
    T = plain.T_cloud_palm.copy()
    T[:, :3] = R_scene_cloud.T @ T[:, :3]
    np.testing.assert_allclose(turned.T_cloud_palm, T, atol=1e-5)


@pytest.mark.parametrize("up", [(0, 0, 1), (0, 0, -2), (0, -1, 0), (0.3, 0.4, -0.1)])
def test_upright_is_the_smallest_turn(up):
    R = upright(up)
    unit = np.array(up) / np.linalg.norm(up)
    np.testing.assert_allclose(R @ unit, [0, 0, 1], atol=1e-12)
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(R) == pytest.approx(1)
    angle = np.arccos(np.clip(unit[2], -1, 1))
    assert Rotation.from_matrix(R).magnitude() == pytest.approx(angle, abs=1e-7)


def test_points_are_rows_of_the_given_cloud(planner, blob):
    dirty = np.insert(blob, [0, 7, 100], np.nan, axis=0)
    grasps = planner(dirty, drop_invalid=True)
    assert np.isfinite(dirty[grasps.point]).all()
    np.testing.assert_array_equal(dirty[grasps.point], blob[planner(blob).point])


def test_few_points_give_one_grasp_each(planner, blob):
    grasps = planner(blob[:130])
    assert len(set(grasps.point)) == len(grasps) == SEEDS
    assert grasps.point.max() < 130


def test_a_table_is_refused_or_removed(planner):
    with_table = clouds.cloud(clouds.box_on_table(), stride=7)
    with pytest.raises(DmfcError, match=r"a table was left in the cloud.*--table remove"):
        planner(with_table)
    grasps = planner(with_table, table="remove")
    on_box = cKDTree(clouds.cloud(clouds.box(), stride=1))
    assert on_box.query(with_table[grasps.point])[0].max() < 0.004
    kept = planner(with_table, table="keep")
    assert on_box.query(with_table[kept.point])[0].max() > 0.1


@pytest.mark.parametrize("wrong", [{"up": (0, 0)}, {"up": (0, 0, 0)}, {"table": "drop"}])
def test_wrong_options_are_told(planner, blob, wrong):
    with pytest.raises(DmfcError, match=r"up is a direction|unknown way with a table"):
        planner(blob, **wrong)


def test_the_shipped_model_loads_by_default(blob):
    grasps = dmfc.load()(blob)
    assert len(grasps) == 512
    assert grasps.joints.shape == (512, 18)
    assert "rh_FFJ4" in grasps.dof_names
    with pytest.raises(DmfcError, match="unknown model 'quik-table1'"):
        dmfc.load("quik-table1")


def test_files(planner, blob, tmp_path):
    grasps = planner(blob)[:5]
    grasps.save(tmp_path / "found.parquet", object_id="cloud/blob")
    back = GraspSet.load(tmp_path / "found.parquet")
    np.testing.assert_allclose(back.T_object_palm, grasps.T_cloud_palm, atol=1e-6)
    np.testing.assert_allclose(back.joints, grasps.joints, atol=1e-6)
    assert back.dof_names == grasps.dof_names
    np.testing.assert_allclose(
        [float(word) for word in back.notes["confidence"].split()], grasps.confidence, rtol=1e-5
    )
    assert np.isnan(back.robustness).all()
    with pytest.raises(DmfcError, match=r"5\.4e\+06 m from the origin.*subtract an offset"):
        planner(blob + np.array([5.4e6, 0, 0])).save(tmp_path / "far.parquet")
