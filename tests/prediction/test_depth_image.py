"""Depth images against the rays of the cameras that made them."""

from __future__ import annotations

import numpy as np
import pytest
from PIL import Image

from dmfc.errors import DmfcError
from dmfc.geometry.transforms import apply
from dmfc.prediction.depth_image import (
    Intrinsics,
    cloud_of_depth,
    depth_unit,
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
    assert depth_unit(image) == "mm"
    assert depth_unit(depth) == "m"
    exact = cloud_of_depth(depth, INTRINSICS)
    np.testing.assert_allclose(cloud_of_depth(image, INTRINSICS) / 1000, exact, atol=0.001)


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


@pytest.mark.parametrize("text", ["1,2,3", "a,b,c,d", "0,1,2,3", "1,2,3,4,5"])
def test_wrong_intrinsics(text):
    with pytest.raises(DmfcError, match="--intrinsics"):
        Intrinsics.parse(text)


def test_poses(tmp_path):
    T = CAMERA.T_world_camera
    np.savetxt(tmp_path / "T.txt", T)
    np.save(tmp_path / "T.npy", T)
    for name in ("T.txt", "T.npy"):
        np.testing.assert_allclose(read_pose(tmp_path / name), T)
    np.savetxt(tmp_path / "scaled.txt", T * 1.5)
    np.savetxt(tmp_path / "mirrored.txt", T * [[1], [1], [-1], [1]])
    np.savetxt(tmp_path / "short.txt", T[:3])
    for name, told in (
        ("scaled.txt", "is no pose"),
        ("mirrored.txt", "is no pose"),
        ("short.txt", "no 4 x 4 matrix"),
        ("missing.txt", "there is no file"),
    ):
        with pytest.raises(DmfcError, match=f"{told}.*--pose"):
            read_pose(tmp_path / name)


def test_images_that_are_none(tmp_path):
    np.save(tmp_path / "colour.npy", np.zeros((4, 5, 3)))
    (tmp_path / "junk.png").write_bytes(b"junk")
    (tmp_path / "d.tiff").write_bytes(b"junk")
    for name, told in (
        ("colour.npy", "one number per pixel"),
        ("junk.png", "cannot be read"),
        ("d.tiff", "known: .png, .npy"),
        ("none.png", "there is no file"),
    ):
        with pytest.raises(DmfcError, match=told):
            read_image(tmp_path / name)
