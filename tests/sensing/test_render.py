"""Depth images: against closed forms, and the two renderers against each other."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
import trimesh
from scipy.ndimage import binary_dilation

from dmfc.config.scenes import CameraConfig
from dmfc.errors import DmfcError
from dmfc.objects.sources import find_object
from dmfc.sensing.cameras import table_cameras
from dmfc.sensing.opengl import _scene_spec
from dmfc.sensing.render import NOTHING, TABLE, available_renderers, open_renderer
from tests.support import scene_shapes

CAMERAS = table_cameras(CameraConfig())
WORKING = [name for name, reason in available_renderers().items() if not reason]


def test_cameras_stand_on_the_four_sides_and_look_at_the_centre():
    config = CameraConfig()
    for number, camera in enumerate(CAMERAS):
        image, depth = camera.project(np.array([0, 0, config.target_height]))
        assert np.allclose(image, [config.width / 2, config.height / 2])
        assert depth == pytest.approx(config.distance)
        azimuth = np.arctan2(camera.position[1], camera.position[0])
        assert np.isclose(np.cos(azimuth - number * np.pi / 2), 1)
        assert np.isclose(np.linalg.det(camera.T_world_camera[:3, :3]), 1)
        up = camera.project(np.array([0, 0, config.target_height + 0.1]))[0]
        assert up[1] < config.height / 2  # rows run downwards


def test_rays_and_projection_are_inverse():
    rows, columns = np.array([0, 10, 359]), np.array([479, 3, 0])
    camera = CAMERAS[1]
    depth = np.array([0.4, 0.7, 1.1])
    points = camera.position + depth[:, None] * camera.rays(rows, columns)
    image, found = camera.project(points)
    assert np.allclose(image, np.stack([columns, rows], 1) + 0.5)
    assert np.allclose(found, depth)


@pytest.mark.parametrize("name", WORKING)
def test_sphere_on_the_table_is_where_it_should_be(name):
    """Every object pixel lies on the sphere, every table pixel on z = 0, and the counts agree with
    the cone under which a camera sees the sphere."""
    radius = 0.05
    ball = scene_shapes.model_of("ball", trimesh.creation.icosphere(4, radius), as_it_stands=True)
    T = np.eye(4)
    T[:3, 3] = [0.03, -0.05, radius]
    renderer = open_renderer(name)
    views = renderer.render(CAMERAS, [ball], T[None], 0.8)
    renderer.close()
    for camera, view in zip(CAMERAS, views, strict=True):
        rows, columns = np.nonzero(view.object_index == 0)
        depth = view.depth[rows, columns].astype(np.float64)[:, None]
        points = camera.position + depth * camera.rays(rows, columns)
        assert np.abs(np.linalg.norm(points - T[:3, 3], axis=1) - radius).max() < 1e-4
        rays = camera.rays(*np.indices(view.depth.shape).reshape(2, -1))
        towards = T[:3, 3] - camera.position
        cosine = rays @ towards / np.linalg.norm(rays, axis=1) / np.linalg.norm(towards)
        inside = cosine > np.sqrt(1 - (radius / np.linalg.norm(towards)) ** 2)
        assert abs(len(rows) / inside.sum() - 1) < 0.01
        rows, columns = np.nonzero(view.object_index == TABLE)
        depth = view.depth[rows, columns].astype(np.float64)[:, None]
        places = camera.position + depth * camera.rays(rows, columns)
        assert np.abs(places[:, 2]).max() < 1e-4
        assert np.abs(places[:, :2]).max() < 0.402
        assert (view.depth[view.object_index == NOTHING] == 0).all()


def test_renderers_agree(scenes, objects, config):
    """Depth within 1 mm and the same ids on all but edge pixels, for all renderers that work."""
    scene = scenes[1]
    models = [objects[name] for name in scene.object_ids]
    _agree(models, scene.T_world_object, config.table_size)


@pytest.mark.full
def test_renderers_agree_on_scans():
    """Meshes of YCB, 16,384 faces each, two of them open: what users grasp, unlike our shapes."""
    names = ("mug", "mustard_bottle", "c_cups")
    meshes = [find_object(f"ycb:{name}").load() for name in names]
    models = [scene_shapes.model_of(f"scan{k}", mesh) for k, mesh in enumerate(meshes)]
    T_world_object = np.tile(np.eye(4), (3, 1, 1))
    for T, model, angle in zip(T_world_object, models, (0.0, 2.1, 4.2), strict=True):
        T[:3, :3] = model.stable_rotations[0]
        T[:3, 3] = [0.08 * np.cos(angle), 0.08 * np.sin(angle), model.stable_heights[0]]
    _agree(models, T_world_object, 0.8)


def _agree(models, T_world_object, table_size):
    seen = {}
    for name in WORKING:
        renderer = open_renderer(name)
        seen[name] = renderer.render(CAMERAS, models, T_world_object, table_size)
        renderer.close()
    reference = seen.pop("embree")
    for views in seen.values():
        for ours, theirs in zip(reference, views, strict=True):
            inner = ~_edges(ours.object_index, ours.depth)
            assert inner.mean() > 0.9
            assert inner[ours.object_index >= 0].mean() > 0.6
            assert (ours.object_index == theirs.object_index)[inner].all()
            assert np.abs(ours.depth - theirs.depth)[inner].max() < 1e-3


def test_embree_sees_what_rays_of_mujoco_meet(scenes, objects, config):
    """The same meshes cast at by MuJoCo, which needs no graphics: 300 pixels of every camera."""
    scene = scenes[1]
    models = [objects[name] for name in scene.object_ids]
    spec = _scene_spec(CAMERAS, models, scene.T_world_object, config.table_size)
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    renderer = open_renderer("embree")
    views = renderer.render(CAMERAS, models, scene.T_world_object, config.table_size)
    renderer.close()
    generator, hits, wrong = np.random.default_rng(0), 0, 0
    for camera, view in zip(CAMERAS, views, strict=True):
        pixels = np.argwhere(view.object_index >= 0)
        rows, columns = generator.choice(pixels, 300, replace=False).T
        for row, column, ray in zip(rows, columns, camera.rays(rows, columns), strict=True):
            geom = np.zeros(1, dtype=np.int32)
            depth = mujoco.mj_ray(model, data, camera.position, ray, None, 1, -1, geom)
            hits += 1
            wrong += (
                geom[0] - 1 != view.object_index[row, column]
                or abs(depth - view.depth[row, column]) > 1e-4
            )
    assert hits == 1200
    assert wrong <= 3  # rays that pass an edge within rounding


def test_nearer_object_hides_the_farther_one(objects):
    model = objects["shape/box"]
    T = np.tile(np.eye(4), (2, 1, 1))
    T[:, 2, 3] = 0.075
    T[0, 0, 3], T[1, 0, 3] = -0.1, 0.1  # camera 0 stands at +x, camera 2 at -x
    renderer = open_renderer("embree")
    views = renderer.render(CAMERAS, [model, model], T, 0.8)
    counts = [[int((view.object_index == k).sum()) for k in (0, 1)] for view in views]
    assert counts[0][0] < counts[0][1]
    assert counts[2][1] < counts[2][0]


def test_auto_prefers_embree_and_unknown_names_are_explained():
    assert open_renderer("auto").name == "embree"
    with pytest.raises(DmfcError, match="did you mean 'embree'"):
        open_renderer("embre")


@pytest.mark.parametrize(
    ("settings", "message"),
    [({"fov_y": 0.0}, "fov_y"), ({"width": 0}, "width"), ({"elevation": 2.0}, "elevation")],
)
def test_impossible_cameras(settings, message):
    with pytest.raises(DmfcError, match=message):
        table_cameras(CameraConfig(**settings))


def _edges(index: np.ndarray, depth: np.ndarray) -> np.ndarray:
    """Pixels within one of a change of id, or of where depth departs by 1 mm from a straight line
    through the pixels beside it: a plane, however steep, has no edges."""
    change = np.zeros(index.shape, dtype=bool)
    for axis in (0, 1):
        bend = np.abs(np.diff(depth, 2, axis=axis)) > 0.001
        other = np.diff(index, axis=axis) != 0
        pad = [(0, 1) if a == axis else (0, 0) for a in (0, 1)]
        change |= np.pad(bend, [(1, 1) if a == axis else (0, 0) for a in (0, 1)])
        change |= np.pad(other, pad) | np.pad(other, [(b, a) for a, b in pad])
    return binary_dilation(change)
