"""The fused cloud lies on the objects' surfaces, with outward normals."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from dmfc.config.scenes import CameraConfig, ScenesConfig, SceneSetConfig
from dmfc.errors import DmfcError
from dmfc.geometry import transforms
from dmfc.scenes.make import SceneMaker
from dmfc.sensing.cameras import table_cameras
from dmfc.sensing.cloud import fuse_views
from dmfc.sensing.render import available_renderers, open_renderer
from tests.support import scene_shapes

WORKING = [name for name, reason in available_renderers().items() if not reason]


@pytest.mark.parametrize("name", WORKING)
def test_points_lie_on_the_surface_with_its_normals(name, scenes, objects, config):
    """Against trimesh's exact closest points: within 0.1 mm (required: 2 mm)."""
    scene = scenes[0]
    models = [objects[object_id] for object_id in scene.object_ids]
    cameras = table_cameras(config.cameras)
    renderer = open_renderer(name)
    views = renderer.render(cameras, models, scene.T_world_object, config.table_size)
    renderer.close()
    generator = np.random.default_rng(0)
    cloud = fuse_views(views, cameras, models, scene.T_world_object, 2048, generator)
    assert cloud.points.shape == cloud.normals.shape == (2048, 3)
    assert len(np.unique(cloud.points, axis=0)) == 2048
    for index, model in enumerate(models):
        mine = cloud.point_object == index
        assert mine.any()
        T_object_world = transforms.inverse(scene.T_world_object[index])
        local = transforms.apply(T_object_world, cloud.points[mine].astype(np.float64))
        normals = transforms.rotate(T_object_world, cloud.normals[mine].astype(np.float64))
        mesh = trimesh.Trimesh(model.vertices, model.faces)
        _, distance, face = trimesh.proximity.closest_point(mesh, local)
        assert distance.max() < 1e-4
        agree = (normals * mesh.face_normals[face]).sum(1) > 1 - 1e-4
        assert agree.mean() > 0.97  # the rest lie on an edge between two triangles
        assert np.abs(np.linalg.norm(normals, axis=1) - 1).max() < 1e-5
        outside = trimesh.proximity.signed_distance(mesh, local + 1e-3 * normals)
        assert (outside < 0).mean() > 0.99


def test_normals_point_outwards_on_a_mesh_wound_inwards(objects):
    """They are turned towards the camera, so the winding of a bad mesh does not matter."""
    model = objects["shape/can"]
    flipped = scene_shapes.with_faces(model, model.faces[:, ::-1].copy())
    cameras = table_cameras(CameraConfig())
    T = np.eye(4)[None].copy()
    T[0, 2, 3] = 0.05
    clouds = []
    for each in (model, flipped):
        views = open_renderer("embree").render(cameras, [each], T, 0.8)
        generator = np.random.default_rng(0)
        clouds.append(fuse_views(views, cameras, [each], T, 500, generator))
    assert np.allclose(clouds[0].normals, clouds[1].normals)


def test_a_small_object_gives_enough_distinct_points():
    """A ball of 4 cm fills the cloud without repeats, wherever it may be placed."""
    mesh = trimesh.creation.icosphere(3, 0.02)
    ball = scene_shapes.model_of("ball", mesh, as_it_stands=True)
    config = ScenesConfig(train=SceneSetConfig(kind="single", count=5))
    with SceneMaker(config, config.train, {ball.id: ball}) as maker:
        for number in range(5):
            assert len(np.unique(maker.make(number).points, axis=0)) == 2048


def test_few_pixels_are_repeated(objects):
    config = ScenesConfig(cameras=CameraConfig(width=24, height=18))
    scenes = SceneSetConfig(kind="single", count=1)
    with SceneMaker(config, scenes, objects) as maker:
        scene = maker.make(0)
    assert scene.points.shape == (2048, 3)
    assert len(np.unique(scene.points, axis=0)) < 2048


def test_nothing_in_sight_is_an_error(objects):
    cameras = table_cameras(CameraConfig())
    model = objects["shape/can"]
    T = np.eye(4)[None].copy()
    T[0, 0, 3] = 50.0
    views = open_renderer("embree").render(cameras, [model], T, 0.8)
    with pytest.raises(DmfcError, match=r"scenes\.cameras"):
        fuse_views(views, cameras, [model], T, 10, np.random.default_rng(0))
