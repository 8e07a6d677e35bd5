"""`dmfc predict` and `dmfc models` as a user calls them."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from dmfc.grasps.grasp_set import GraspSet
from dmfc.prediction.cloud_check import CloudCheck
from dmfc.prediction.planner import load
from tests.support import clouds

ROOT = Path(__file__).resolve().parents[2]
HEAVY = ("mujoco", "ray", "mlflow", "lightning", "pandas", "coacd", "pytorch_kinematics")


@pytest.fixture(scope="module")
def box_file(tmp_path_factory):
    path = tmp_path_factory.mktemp("cloud") / "box.npy"
    np.save(path, clouds.cloud(clouds.box()))
    return path


def test_json_is_what_python_answers(dmfc, box_file):
    status, out, _ = dmfc("predict", box_file, "--json", "--top", 3)
    assert status == 0
    told = json.loads(out)
    grasps = load()(np.load(box_file))
    assert len(told["grasps"]) == 3
    for k, grasp in enumerate(told["grasps"]):
        np.testing.assert_allclose(grasp["T_cloud_palm"], grasps.T_cloud_palm[k], atol=1e-5)
        np.testing.assert_allclose(grasp["joints"], grasps.joints[k], atol=1e-5)
    assert told["dof_names"] == grasps.dof_names


def test_files_and_table(dmfc, box_file, tmp_path):
    found, picture = tmp_path / "found.parquet", tmp_path / "found.png"
    status, out, _ = dmfc("predict", box_file, "--out", found, "--picture", picture)
    assert status == 0
    assert "512 grasps by" in out
    assert len(GraspSet.load(found)) == 512
    pixels = np.asarray(Image.open(picture).convert("RGB")).astype(int)
    coloured = (np.ptp(pixels, axis=2) > 60).mean()  # glyphs; axes and cloud are grey
    assert coloured > 0.02


def test_checked_grasps_are_fewer_and_none_at_all_is_an_error(dmfc, box_file, monkeypatch):
    status, out, _ = dmfc("predict", box_file, "--json", "--check")
    assert status == 0
    assert 0 < len(json.loads(out)["grasps"]) < 512
    monkeypatch.setattr(CloudCheck, "clear", lambda self, T, joints, points: np.zeros(len(T), bool))
    status, _, err = dmfc("predict", box_file, "--check")
    assert status == 1
    assert "go without --check" in err


def test_a_depth_image_gives_grasps_in_the_world(dmfc, tmp_path):
    camera = clouds.CAMERAS[0]
    depth = clouds.depth_image(clouds.box_on_table(), camera)
    alone = clouds.depth_image(clouds.box(), camera) > 0
    np.save(tmp_path / "d.npy", depth)
    np.save(tmp_path / "mask.npy", alone)
    np.savetxt(tmp_path / "T.txt", camera.T_world_camera)
    intrinsics = f"{camera.focal},{camera.focal},{camera.width / 2 - 0.5},{camera.height / 2 - 0.5}"
    call = ["predict", tmp_path / "d.npy", "--intrinsics", intrinsics, "--json"]
    status, _, err = dmfc(*call, "--mask", tmp_path / "mask.npy")
    assert status == 1
    assert "which way is up" in err
    status, out, _ = dmfc(*call, "--mask", tmp_path / "mask.npy", "--pose", tmp_path / "T.txt")
    assert status == 0
    grasps = json.loads(out)["grasps"]
    palms = np.array([grasp["T_cloud_palm"] for grasp in grasps])[:, :3, 3]
    assert np.linalg.norm(palms[:100] - [0, 0, 0.06], axis=1).max() < 0.25  # the most confident
    status, _, err = dmfc(*call, "--pose", tmp_path / "T.txt")
    assert status == 1
    assert "a table was left in the cloud" in err


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["--unit", "mm"], "say --unit m,"),
        (["--model", "nothing"], "unknown model 'nothing'"),
        (["--up", "a,b,c"], "--up wants three numbers"),
        (["--top", "-1"], "--top -1"),
        (["--mask", "m.png"], "give --intrinsics"),
    ],
)
def test_errors_are_one_line(dmfc, box_file, arguments, told):
    status, _, err = dmfc("predict", box_file, *arguments)
    assert status == 1
    assert told in err
    assert len(err.strip().splitlines()) == 1


def test_predicting_needs_neither_simulator_nor_orchestration(box_file):
    code = f"""
import sys
sys.modules.update(dict.fromkeys({HEAVY}))
sys.argv = ["dmfc", "predict", {str(box_file)!r}, "--top", "2"]
from dmfc.cli.main import main
main()
"""
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True)
    assert "2 grasps by" in done.stdout, done.stderr


def test_importing_dmfc_imports_nothing_else():
    code = "import sys, dmfc; print('numpy' in sys.modules, 'torch' in sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True
    )
    assert done.stdout.split() == ["False", "False"]


def test_models_are_listed(dmfc):
    status, out, _ = dmfc("models", "list", "--json")
    assert status == 0
    assert sum(row["default"] for row in json.loads(out)) == 1
