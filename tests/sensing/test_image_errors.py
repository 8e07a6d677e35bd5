"""Errors of images and masks, against brute force and closed forms."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy import ndimage

from dmfc.config.load import load_config
from dmfc.config.scenes import SceneSetConfig, SensorConfig
from dmfc.engine.stage import plain
from dmfc.errors import DmfcError
from dmfc.scenes.make import SceneMaker
from dmfc.sensing.depth import object_pixels
from dmfc.sensing.image_errors import observed_views, seen_at_an_angle
from dmfc.sensing.render import NOTHING, TABLE


@pytest.fixture
def seen(config, objects, scenes):
    """The images of a scene, and what is needed to fuse them."""
    scene = scenes[2]
    models = [objects[name] for name in scene.object_ids]
    with SceneMaker(config, config.train, objects) as maker:
        return maker.views(models, scene.T_world_object), maker.cameras, models, scene


def made(config, objects, number=2, **errors):
    """A scene as cameras with errors see it."""
    noisy = dataclasses.replace(config.train, sensor=SensorConfig(**errors))
    with SceneMaker(config, noisy, objects) as maker:
        return maker.make(number)


def test_exact_cameras_have_the_keys_and_records_that_they_had():
    names = ["noise", "dropped", "camera_shift", "camera_turn"]
    assert list(plain(SceneSetConfig())["sensor"]) == names
    assert list(plain(SceneSetConfig(sensor=SensorConfig(mask=1)))["sensor"]) == [*names, "mask"]


def test_cameras_that_are_not_there_see_nothing(config, objects):
    assert set(made(config, objects, cameras=[2, 0]).point_camera) == {0, 2}
    for cameras in ("[]", "[1, 1]"):
        with pytest.raises(DmfcError, match=r"scenes\.test\.sensor\.cameras .* each once"):
            load_config("smoke", [f"scenes.test.sensor.cameras={cameras}"])


def test_a_crop_keeps_the_middle_of_the_image(seen):
    views, *_ = seen
    height, width = views[0].depth.shape
    found = observed_views(SensorConfig(crop=0.5), views, np.random.default_rng(0))
    rows, columns = slice(height // 4, height - height // 4), slice(width // 4, width - width // 4)
    for before, after in zip(views, found, strict=True):
        assert (after.object_index[rows, columns] == before.object_index[rows, columns]).all()
        outside = np.ones((height, width), dtype=bool)
        outside[rows, columns] = False
        assert (after.object_index[outside] == NOTHING).all()
        assert (after.depth[outside] == 0).all()


@pytest.mark.parametrize("pixels", [2, -2])
def test_masks_are_wider_or_narrower_by_so_many_pixels(seen, pixels):
    """Against SciPy's binary dilation and erosion by a square of 5 x 5."""
    views, *_ = seen
    found = observed_views(SensorConfig(mask=pixels), views, np.random.default_rng(0))
    square = np.ones((5, 5), dtype=bool)
    for before, after in zip(views, found, strict=True):
        mask = before.object_index >= 0
        if pixels > 0:
            wanted = mask | (ndimage.binary_dilation(mask, square) & (before.object_index == TABLE))
        else:
            wanted = ndimage.binary_erosion(mask, square, border_value=1)
        assert ((after.object_index >= 0) == wanted).all()
        assert (after.depth == before.depth).all()


def test_edges_bleed_towards_what_is_behind(seen):
    views, *_ = seen
    found = observed_views(SensorConfig(bleeding=1), views, np.random.default_rng(0))
    changed = 0
    for before, after in zip(views, found, strict=True):
        for row, column in zip(*np.nonzero(after.depth != before.depth), strict=True):
            near = before.depth[max(row - 1, 0) : row + 2, max(column - 1, 0) : column + 2]
            assert before.object_index[row, column] >= 0
            assert near.max() - before.depth[row, column] > 0.01
            assert before.depth[row, column] < after.depth[row, column] <= near.max()
            changed += 1
    edges = sum(
        ((v.object_index >= 0) & (ndimage.maximum_filter(v.depth, 3) - v.depth > 0.01)).sum()
        for v in views
    )
    assert 0.95 * edges < changed <= edges


def test_steep_surfaces_are_lost_in_proportion(seen):
    views, cameras, models, scene = seen
    pixels = object_pixels(views)
    sensor = SensorConfig(grazing=1.2)
    given = (pixels, cameras, models, scene.T_world_object)
    counts = np.zeros(len(pixels))
    where = {}
    for k, key in enumerate(zip(pixels.camera, pixels.row, pixels.column, strict=True)):
        where[key] = k
    repeats = 40
    for seed in range(repeats):
        kept = seen_at_an_angle(sensor, *given, np.random.default_rng(seed))
        for key in zip(kept.camera, kept.row, kept.column, strict=True):
            counts[where[key]] += 1
    # The angle from the normal of the triangle that was hit.
    _, towards = pixels.points(cameras)
    share = np.empty(len(pixels))
    for k in range(len(pixels)):
        model = models[pixels.object_index[k]]
        corners = model.vertices[model.faces[pixels.face[k]]]
        normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
        normal = scene.T_world_object[pixels.object_index[k]][:3, :3] @ normal
        sine = abs(normal @ towards[k]) / np.linalg.norm(normal) / np.linalg.norm(towards[k])
        share[k] = min(np.arcsin(min(sine, 1.0)) / 1.2, 1.0)
    assert (counts[share == 1] == repeats).all()
    assert counts.sum() / repeats == pytest.approx(share.sum(), rel=0.02)
    assert np.corrcoef(counts, share)[0, 1] > 0.9


def test_a_share_of_the_points_is_table_near_the_objects(config, objects, scenes):
    found = made(config, objects, table=0.25)
    table = np.abs(found.points[:, 2]) < 1e-4
    flat = table & (found.normals[:, 2] > 0.999)
    assert flat.sum() >= 512
    assert flat.sum() - 512 < 20  # the rest are points of objects where they touch the table
    exact = scenes[2].points[:, :2]
    distance = np.linalg.norm(found.points[flat][:, None, :2] - exact[None], axis=2).min(1)
    assert distance.max() < 0.055
    assert (found.T_world_object == scenes[2].T_world_object).all()


def test_distances_are_multiples_of_the_quantum(config, objects):
    found = made(config, objects, quantum=0.004)
    with SceneMaker(config, config.train, objects) as maker:
        centres = np.stack([camera.position for camera in maker.cameras])
    steps = np.linalg.norm(found.points - centres[found.point_camera], axis=1) / 0.004
    assert np.abs(steps - np.rint(steps)).max() < 0.01  # a shard's own step is 0.01 mm
    assert len(np.unique(np.rint(steps))) > 5


def test_a_view_that_is_cut_off_entirely_is_one_line(config, objects):
    far = dataclasses.replace(
        config, cameras=dataclasses.replace(config.cameras, target_height=0.9)
    )
    with pytest.raises(DmfcError, match="no object is in sight"):
        made(far, objects, crop=0.9)
