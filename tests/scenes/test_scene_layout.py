"""Objects stand on the table, apart from each other, and each scene depends on its number alone."""

from __future__ import annotations

import dataclasses
from collections import Counter

import mujoco
import numpy as np
import pytest
import trimesh

from dmfc.config.scenes import ScenesConfig, SceneSetConfig
from dmfc.errors import DmfcError
from dmfc.geometry import transforms
from dmfc.scenes.layout import choose_objects, make_layout
from dmfc.scenes.placement import CollisionWorld
from tests.support import scene_shapes

MULTI = SceneSetConfig(kind="multi", count=20)
CONFIG = ScenesConfig(train=MULTI)


def test_no_two_objects_overlap(objects):
    """Against trimesh: no surface point is deeper than 0.1 mm in another object's mesh."""
    for number in range(8):
        layout = make_layout(CONFIG, MULTI, objects, number)
        placed = [
            trimesh.Trimesh(objects[name].vertices, objects[name].faces).apply_transform(T)
            for name, T in zip(layout.object_ids, layout.T_world_object, strict=True)
        ]
        assert 3 <= len(placed) <= 5
        for i, mesh in enumerate(placed):
            for other in placed[:i]:
                points = trimesh.sample.sample_surface(mesh, 400, seed=0)[0]
                assert trimesh.proximity.signed_distance(other, points).max() < 1e-4
                points = trimesh.sample.sample_surface(other, 400, seed=0)[0]
                assert trimesh.proximity.signed_distance(mesh, points).max() < 1e-4


def test_objects_touch_the_table_and_stay_on_it(objects):
    for number in range(20):
        layout = make_layout(CONFIG, MULTI, objects, number)
        for name, T in zip(layout.object_ids, layout.T_world_object, strict=True):
            vertices = transforms.apply(T, objects[name].vertices)
            assert abs(vertices[:, 2].min()) < 1e-6
            assert np.abs(vertices[:, :2]).max() <= CONFIG.table_size / 2
            assert np.allclose(T[:3, :3] @ T[:3, :3].T, np.eye(3))
            assert np.isclose(np.linalg.det(T[:3, :3]), 1)


def test_an_object_whose_parts_fall_short_of_its_mesh_is_put_lower():
    """Parts that end 3 mm above the mesh's underside: the object falls 1 mm, not 3."""
    size = np.array([0.06, 0.09, 0.15])
    box = scene_shapes.model_of("box", scene_shapes.box_mesh(tuple(size)))
    less = [np.array(scene_shapes.box_mesh(tuple(size - 0.006)).vertices)]
    short = dataclasses.replace(box, convex_parts=less)
    scenes = SceneSetConfig(kind="single", count=5)
    for number in range(5):
        whole = make_layout(CONFIG, scenes, {box.id: box}, number).T_world_object[0]
        lower = make_layout(CONFIG, scenes, {box.id: short}, number).T_world_object[0]
        assert lower[2, 3] == pytest.approx(whole[2, 3] - 0.002)
        assert transforms.apply(lower, less[0])[:, 2].min() == pytest.approx(0.001)


def test_objects_rest_in_mujoco(objects):
    """Released, they move less than 2 mm in 2 s."""
    for number in range(4):
        layout = make_layout(CONFIG, MULTI, objects, number)
        spec = mujoco.MjSpec()
        spec.option.timestep = 0.004
        spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[1, 1, 0.1])
        for k, (name, T) in enumerate(zip(layout.object_ids, layout.T_world_object, strict=True)):
            quaternion = np.zeros(4)
            mujoco.mju_mat2Quat(quaternion, T[:3, :3].ravel())
            body = spec.worldbody.add_body(pos=T[:3, 3], quat=quaternion)
            body.add_freejoint()
            for j, part in enumerate(objects[name].convex_parts):
                mesh = spec.add_mesh(name=f"{k}-{j}")
                mesh.uservert = part.astype(np.float32).ravel()
                body.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname=mesh.name)
        model = spec.compile()
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        start = data.xipos.copy()
        mujoco.mj_step(model, data, nstep=500)
        assert np.linalg.norm(data.xipos - start, axis=1).max() < 0.002


def test_scene_depends_on_seed_and_number_alone(objects):
    world = CollisionWorld()
    in_order = [make_layout(CONFIG, MULTI, objects, number, world) for number in range(5)]
    alone = make_layout(CONFIG, MULTI, dict(reversed(objects.items())), 4)
    assert alone.object_ids == in_order[4].object_ids
    assert (alone.T_world_object == in_order[4].T_world_object).all()
    other = make_layout(CONFIG, dataclasses.replace(MULTI, seed=1), objects, 4)
    assert not np.array_equal(other.T_world_object, alone.T_world_object)


@pytest.mark.parametrize("kind", ["single", "multi"])
def test_objects_appear_about_equally_often(kind):
    names = [f"o{i:02d}" for i in range(16)]
    scenes = SceneSetConfig(kind=kind, count=100)
    chosen = [choose_objects(scenes, names, number) for number in range(100)]
    counts = Counter(name for scene in chosen for name in scene)
    assert set(counts) == set(names)
    assert max(counts.values()) - min(counts.values()) <= (1 if kind == "single" else 6)
    assert all(len(set(scene)) == len(scene) for scene in chosen)


def test_choice_over_ten_thousand_scenes_is_random_access():
    names = [f"o{i:03d}" for i in range(533)]
    scenes = SceneSetConfig(kind="multi", count=10_000)
    assert choose_objects(scenes, names, 9_999) == choose_objects(scenes, names, 9_999)


def test_stable_poses_are_drawn_by_probability():
    box = scene_shapes.model_of("box", scene_shapes.box_mesh((0.06, 0.09, 0.15)))
    scenes = SceneSetConfig(kind="single", count=600)
    heights = [
        make_layout(CONFIG, scenes, {box.id: box}, number).T_world_object[0, 2, 3]
        for number in range(600)
    ]
    drawn = Counter(np.round(heights, 6).tolist())
    for height in np.unique(np.round(box.stable_heights, 6)):
        expected = box.stable_probabilities[np.isclose(box.stable_heights, height)].sum()
        error = np.sqrt(expected * (1 - expected) / 600)
        assert abs(drawn[float(height)] / 600 - expected) < 4 * error + 1e-3


def test_standard_pose_is_upright(objects):
    scenes = SceneSetConfig(kind="single_standard", count=10)
    for number in range(10):
        T = make_layout(CONFIG, scenes, objects, number).T_world_object[0]
        assert T[2, 2] == pytest.approx(1)


@pytest.mark.parametrize(
    ("config", "scenes", "names", "message"),
    [
        (CONFIG, MULTI, [], "objects.train"),
        (ScenesConfig(table_size=0.1), MULTI, None, "scenes.table_size"),
        (CONFIG, SceneSetConfig(kind="multi", min_objects=4, max_objects=3), None, "max_objects"),
    ],
)
def test_errors_name_the_setting(config, scenes, names, message, objects):
    chosen = objects if names is None else {}
    with pytest.raises(DmfcError, match=message):
        make_layout(config, scenes, chosen, 0)
