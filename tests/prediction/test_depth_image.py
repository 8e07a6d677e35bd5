"""Depth images against the rays of the cameras that made them."""

from __future__ import annotations

import numpy as np
import pytest
from PIL import Image

from dmfc.errors import DmfcError
from dmfc.geometry.transforms import apply
from dmfc.prediction.depth_image import (
    Intrinsics,
    check_depth,
    cloud_of_depth,
    depth_in_metres,
    parse_scale,
    read_image,
    read_pose,
)
from tests.support import clouds

CAMERA = clouds.CAMERAS[1]
INTRINSICS = Intrinsics(CAMERA.focal, CAMERA.focal, CAMERA.width / 2 - 0.5, CAMERA.height / 2 - 0.5)


@pytest.fixture(scope="module")
def depth():
    return clouds.depth_image(clouds.box(), CAMERA)


def test_points_lie_where_the_rays_hit(depth):
    rows, columns = np.nonzero(depth)
    expected = CAMERA.position + depth[rows, columns][:, None] * CAMERA.rays(rows, columns)
    points = apply(CAMERA.T_world_camera, cloud_of_depth(depth, INTRINSICS))
    np.testing.assert_allclose(points, expected, atol=1e-12)
    assert points[:, 2].min() > -1e-6
    assert points[:, 2].max() == pytest.approx(0.12)


def test_a_png_in_millimetres(tmp_path, depth):
    Image.fromarray(np.round(depth * 1000).astype(np.uint16)).save(tmp_path / "d.png")
    image = read_image(tmp_path / "d.png")
    exact = cloud_of_depth(depth, INTRINSICS)
    found = cloud_of_depth(depth_in_metres(image), INTRINSICS)
    np.testing.assert_allclose(found, exact, atol=0.001)
    np.testing.assert_array_equal(cloud_of_depth(depth_in_metres(depth), INTRINSICS), exact)


@pytest.mark.parametrize(
    ("counts", "option"),
    [
        (5000, {"scale": "1/5000"}),
        (10000, {"scale": "0.0001"}),
        (100, {"unit": "cm"}),
        (1000, {}),
    ],
)
def test_a_scale_is_taken_as_it_is_given(depth, counts, option):
    whole = np.round(depth * counts).astype(np.uint16)
    found = depth_in_metres(whole, **option)
    seen = depth > 0
    assert np.isnan(found[~seen]).all()
    assert np.abs(found - depth)[seen].max() <= 0.5001 / counts


def test_no_answer_is_no_depth():
    whole = np.array([[0, 500, 65535, 65534]], dtype=np.uint16)
    np.testing.assert_array_equal(depth_in_metres(whole), [[np.nan, 0.5, np.nan, 65.534]])
    real = np.array([[np.nan, np.inf, -1.0, 0.0, 0.5]])
    np.testing.assert_array_equal(depth_in_metres(real), [[np.nan] * 4 + [0.5]])


@pytest.mark.parametrize("kind", [np.uint8, np.int8, bool])
def test_eight_bits_hold_no_depth(kind):
    with pytest.raises(DmfcError, match="8 bits per pixel"):
        depth_in_metres(np.ones((4, 4), dtype=kind))


@pytest.mark.parametrize(
    "text", ["", "x", "0", "-0.001", "nan", "inf", "1/0", "5000", "1/x", "1e999"]
)
def test_wrong_scales(text):
    with pytest.raises(DmfcError, match=r"--depth-scale"):
        parse_scale(text)
    with pytest.raises(DmfcError, match="did you mean 1/5000"):
        parse_scale("5000")


def test_an_implausible_depth_is_told_unless_its_unit_is_stated(depth):
    """A camera's 0.6 m in 1/5000 m, read as millimetres, would be 3 m."""
    points = cloud_of_depth(depth, INTRINSICS)
    away = np.median(points[:, 2])
    check_depth(points)
    for factor in (5, 10, 100, 0.1):
        with pytest.raises(
            DmfcError, match=rf"{away * factor:.3g} m from the camera.*--depth-scale"
        ):
            check_depth(points * factor)
    check_depth(points * 5, "--unit mm")
    with pytest.raises(DmfcError, match="when the depth is read with --unit m:"):
        check_depth(points * 1000, "--unit m")
    with pytest.raises(DmfcError, match="no pixel of the mask has a depth"):
        check_depth(points[:0])


def test_mask_and_missing_depth(depth):
    dirty = depth.copy()
    rows, columns = np.nonzero(depth)
    dirty[rows[0], columns[0]] = np.nan
    dirty[rows[1], columns[1]] = np.inf
    assert len(cloud_of_depth(dirty, INTRINSICS)) == len(rows) - 2
    mask = np.zeros(depth.shape, dtype=bool)
    mask[rows[5:9], columns[5:9]] = True
    np.testing.assert_array_equal(
        cloud_of_depth(depth, INTRINSICS, mask), cloud_of_depth(depth, INTRINSICS)[5:9]
    )
    with pytest.raises(DmfcError, match=r"mask is 480 x 10 pixels, the depth image 480 x 360"):
        cloud_of_depth(depth, INTRINSICS, mask[:10])


@pytest.mark.parametrize(
    "text",
    ["1,2,3", "a,b,c,d", "0,1,2,3", "1,2,3,4,5", "inf,inf,1,1", "600,600,nan,1", "600,60,1,1"],
)
def test_wrong_intrinsics(text):
    with pytest.raises(DmfcError, match="--intrinsics"):
        Intrinsics.parse(text)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("600,600,1000,180", "outside the image"),
        ("600,600,-1,180", "outside the image"),
        ("600,600,240,360", "outside the image"),
        ("1200,1200,479.5,359.5", r"the middle of 960 x 720 pixels.*480 x 360 pixels"),
        ("300,300,119.5,89.5", r"the middle of 240 x 180 pixels.*480 x 360 pixels"),
    ],
)
def test_intrinsics_of_another_resolution(depth, text, told):
    with pytest.raises(DmfcError, match=told):
        cloud_of_depth(depth, Intrinsics.parse(text))


@pytest.mark.parametrize("text", ["600,590,239.5,179.5", "600,600,221,190", "600,600,120,170"])
def test_intrinsics_of_a_real_camera_or_a_crop_pass(depth, text):
    assert len(cloud_of_depth(depth, Intrinsics.parse(text)))


def test_poses(tmp_path):
    T = CAMERA.T_world_camera
    np.savetxt(tmp_path / "T.txt", T)
    np.save(tmp_path / "T.npy", T)
    for name in ("T.txt", "T.npy"):
        np.testing.assert_allclose(read_pose(tmp_path / name), T)
    np.savetxt(tmp_path / "scaled.txt", T * 1.5)
    np.savetxt(tmp_path / "mirrored.txt", T * [[1], [1], [-1], [1]])
    np.savetxt(tmp_path / "short.txt", T[:3])
    np.savetxt(tmp_path / "nan.txt", T * [[1], [1], [1], [np.nan]])
    (tmp_path / "empty.npy").touch()
    for name, told in (
        ("scaled.txt", "is not a pose"),
        ("mirrored.txt", "is not a pose"),
        ("short.txt", "cannot be read as a 4 x 4 matrix"),
        ("empty.npy", "is empty: it has 0 bytes"),
        ("nan.txt", "is not a pose"),
        ("missing.txt", "there is no file"),
    ):
        with pytest.raises(DmfcError, match=f"{told}.*--pose"):
            read_pose(tmp_path / name)


def test_images_that_are_none(tmp_path):
    np.save(tmp_path / "colour.npy", np.zeros((4, 5, 3)))
    np.save(tmp_path / "text.npy", np.full((4, 5), "x"))
    (tmp_path / "empty.png").touch()
    (tmp_path / "junk.png").write_bytes(b"junk")
    (tmp_path / "d.tiff").write_bytes(b"junk")
    for name, told in (
        ("colour.npy", "one number per pixel"),
        ("junk.png", "cannot be read"),
        ("d.tiff", "known: .png, .npy"),
        ("none.png", "there is no file"),
        ("empty.png", "is empty: it has 0 bytes"),
        ("text.npy", "one number per pixel"),
    ):
        with pytest.raises(DmfcError, match=told):
            read_image(tmp_path / name)
