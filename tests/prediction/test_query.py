"""What `predict` and `view` ask alike: files of clouds and depth images, in one frame, checked."""

from __future__ import annotations

import inspect
from dataclasses import fields

import numpy as np
import pytest
from PIL import Image

from dmfc.cli.predict import predict
from dmfc.cli.view import view
from dmfc.errors import DmfcError
from dmfc.geometry.transforms import apply
from dmfc.prediction.planner import load
from dmfc.prediction.query import CloudQuery
from tests.support import clouds

CAMERA = clouds.CAMERAS[0]
INTRINSICS = f"{CAMERA.focal},{CAMERA.focal},{CAMERA.width / 2 - 0.5},{CAMERA.height / 2 - 0.5}"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A depth image of a box in 1/5000 m, its camera's pose, and clouds."""
    folder = tmp_path_factory.mktemp("query")
    depth = clouds.depth_image(clouds.box(), CAMERA)
    whole = np.round(depth * 5000).astype(np.uint16)
    whole[0, 0] = 65535
    Image.fromarray(whole).save(folder / "tum.png")
    picture = (np.clip(depth / 2, 0, 1) * 255).astype(np.uint8)
    Image.fromarray(picture).save(folder / "picture.png")
    np.savetxt(folder / "T.txt", CAMERA.T_world_camera)
    np.save(folder / "blob.npy", clouds.blob())
    np.save(folder / "dirty.npy", np.concatenate([np.zeros((50, 3)), clouds.blob()]))
    return folder


def test_both_verbs_have_every_option_of_a_query():
    for verb in (predict, view):
        missing = {field.name for field in fields(CloudQuery)} - set(
            inspect.signature(verb).parameters
        )
        assert missing <= {"file"}


def test_a_scale_puts_a_depth_image_where_the_object_is(folder):
    query = CloudQuery(folder / "tum.png", intrinsics=INTRINSICS, pose=folder / "T.txt")
    with pytest.raises(DmfcError, match=r"m from the camera.*--depth-scale 1/5000"):
        query.cloud()
    scaled = CloudQuery(
        folder / "tum.png", intrinsics=INTRINSICS, pose=folder / "T.txt", depth_scale="1/5000"
    )
    low, high = scaled.cloud().points.min(0), scaled.cloud().points.max(0)
    assert low[2] > -0.001
    assert high[2] == pytest.approx(0.12, abs=0.001)


def test_points_without_an_answer_are_left_out_before_the_pose_moves_them(folder):
    asked = {"pose": folder / "T.txt"}
    with pytest.raises(DmfcError, match=r"50 of 3050 points are exactly"):
        CloudQuery(folder / "dirty.npy", **asked).cloud()
    found = CloudQuery(folder / "dirty.npy", drop_invalid=True, **asked).cloud()
    np.testing.assert_allclose(found.points, apply(CAMERA.T_world_camera, clouds.blob()))
    np.testing.assert_array_equal(found.rows, np.arange(50, 3050))


def test_a_grasp_names_the_row_of_the_file(folder, stage_folder):
    query = CloudQuery(folder / "dirty.npy", model=str(stage_folder), drop_invalid=True)
    points, grasps = query.answer()
    np.testing.assert_array_equal(points, clouds.blob())
    np.testing.assert_array_equal(grasps.point, load(stage_folder)(clouds.blob()).point + 50)


@pytest.mark.parametrize(
    ("options", "told"),
    [
        ({"unit": "feet"}, "unknown unit 'feet'"),
        ({"unit": "feet", "pose": "T.txt"}, "unknown unit 'feet'"),
        ({"unit": "mm", "pose": "T.txt"}, "say --unit m,"),
        ({"depth_scale": "0.001"}, "--depth-scale belongs to a depth image"),
        ({"mask": "picture.png"}, "--mask belongs to a depth image"),
        ({"up": "0,0"}, "up is a direction of three numbers"),
        ({"pose": "blob.npy"}, "cannot be read as a 4 x 4 matrix"),
        ({"file": "tum.png", "intrinsics": INTRINSICS}, "which way is up"),
        ({"file": "picture.png", "intrinsics": INTRINSICS, "up": "0,-1,0"}, "8 bits per pixel"),
        ({"file": "tum.png", "intrinsics": INTRINSICS, "up": "0,-1,0", "unit": "mm",
          "depth_scale": "1/5000"}, "give one of them"),
        ({"file": "tum.png", "intrinsics": "900,900,639.5,479.5", "up": "0,-1,0"},
         "the intrinsics of this resolution"),
    ],
)  # fmt: skip
def test_what_does_not_fit_together_is_one_line(folder, options, told):
    given = {"file": "blob.npy", **options}
    for name in ("file", "mask", "pose"):
        if name in given:
            given[name] = folder / given[name]
    with pytest.raises(DmfcError, match=told) as error:
        CloudQuery(**given).answer()
    assert "\n" not in str(error.value)
