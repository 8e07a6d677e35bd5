"""The arrays of a view against MuJoCo, trimesh and closed forms."""

from __future__ import annotations

import dataclasses

import mujoco
import numpy as np
import pytest
import trimesh

from dmfc.config.execution import ExecutionConfig
from dmfc.config.physics import PhysicsConfig
from dmfc.errors import DmfcError
from dmfc.execution.candidates import GraspCandidates
from dmfc.execution.evaluate import Evaluation
from dmfc.hand.mjcf import PREFIX
from dmfc.physics.world import World
from dmfc.view import data
from dmfc.view import scene as view_scene
from dmfc.view.data import Mesh, cloud_view
from dmfc.view.page import page_data
from dmfc.view.record import record_trial
from dmfc.view.scene import evaluated_view
from tests.support.execution_shapes import good, scene_of, standing
from tests.support.grasp_shapes import planned, shadow, shape


def test_links_lie_where_mujoco_has_them(view, grasps, hand):
    world = World(shadow()[1], [], PhysicsConfig())
    for g in (0, 17, 39):
        world.reset()
        world.place_palm(grasps.T_cloud_palm[g], grasps.joints[g])
        mujoco.mj_kinematics(world.model, world.data)
        for link, name in enumerate(hand.link_names):
            body = world.data.body(name if name.startswith(PREFIX) else PREFIX + name)
            T = view.grasps.T_world_link[g, link]
            np.testing.assert_allclose(T[:3, 3], body.xpos, atol=1e-6)
            np.testing.assert_allclose(T[:3, :3], body.xmat.reshape(3, 3), atol=1e-6)


def test_a_glyph_is_short_and_faces_where_the_palm_does(view, grasps, hand):
    wrist, centre, tip = view.grasps.glyphs.transpose(1, 0, 2)
    T = grasps.T_cloud_palm
    expected = T[:, :3, :3] @ hand.palm_reference + T[:, :3, 3]
    np.testing.assert_allclose(centre, expected, atol=1e-12)
    np.testing.assert_allclose(tip - centre, 0.02 * T[:, :3, :3] @ hand.palm_normal, atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(wrist - centre, axis=1), data.STEM)
    towards = T[:, :3, 3] - expected
    parallel = np.cross(wrist - centre, towards)
    np.testing.assert_allclose(parallel, 0, atol=1e-12)


def test_thinned_meshes_stay_on_the_surface(view, hand):
    for mesh, vertices, faces in zip(view.hand, hand.link_vertices, hand.link_faces, strict=True):
        assert len(mesh.faces) <= 1.02 * data.LINK_FACES
        assert mesh.faces.max() < len(mesh.vertices)
        whole = trimesh.Trimesh(vertices, faces, process=False)
        away = trimesh.proximity.closest_point(whole, mesh.vertices[::7])[1]
        assert np.median(away) < 0.0001
        assert away.max() < 0.002


def test_a_small_mesh_is_left_as_it_is():
    box = trimesh.creation.box()
    mesh = Mesh.thinned("box", box.vertices, box.faces, 100)
    np.testing.assert_array_equal(mesh.faces, box.faces)


def test_upwards_becomes_z_and_the_table_lies_below(grasps, hand):
    points = np.random.default_rng(0).uniform([0.2, 0, 0], [0.5, 0.1, 0.1], (500, 3))
    shown = cloud_view(points, grasps, hand, "lying", up=(1.0, 0.0, 0.0))
    np.testing.assert_allclose(shown.R_view_world @ [1, 0, 0], [0, 0, 1], atol=1e-12)
    assert shown.floor == pytest.approx(points[:, 0].min())


def test_large_clouds_are_thinned(grasps, hand):
    points = np.random.default_rng(0).uniform(0, 0.1, (2 * data.POINTS + 1, 3))
    shown = cloud_view(points, grasps, hand, "many").points
    assert data.POINTS / 2 < len(shown) <= data.POINTS


@pytest.fixture(scope="module")
def evaluation(hand, description_of_scene):
    scene, description = description_of_scene
    return Evaluation(
        source="planner",
        scenes=[scene],
        objects={shape("block").id: shape("block")},
        grasps={shape("block").id: planned("block")},
        network=None,
        hand=hand,
        description=description,
        physics=PhysicsConfig(),
        config=ExecutionConfig(),
    )


@pytest.fixture(scope="module")
def description_of_scene(shadow_hand_dir):
    labels = [(0, row) for row in range(len(planned("block")))]
    return scene_of(5, ["block"], [standing("block")], labels), shadow()[1]


def test_a_held_trial_ends_with_the_object_in_the_air(evaluation, description_of_scene):
    scene = dataclasses.replace(
        description_of_scene[0],
        grasp_index=np.array(good("block")[:1], np.int32),
        grasp_object=np.zeros(1, np.uint8),
    )
    shown = evaluated_view(evaluation, scene, 0, "planner")
    motion = shown.motion
    assert motion is not None
    assert motion.outcome == "held"
    assert "held" in shown.title
    assert (np.diff(motion.seconds) > 0).all()
    assert motion.seconds[0] == pytest.approx(0.1, abs=0.01)
    assert motion.phase[0] == "raise"
    assert motion.phase[-1] == "hold"
    start = scene.T_world_object[0]
    np.testing.assert_allclose(motion.T_world_object[0, 0], start, atol=2e-3)
    risen = (motion.T_world_link[-1] - motion.T_world_link[motion.phase.index("lift")])[0, 2, 3]
    lifted = motion.T_world_object[-1, 0, 2, 3] - start[2, 3]
    assert lifted > 0.08
    assert lifted == pytest.approx(risen, abs=0.02)
    # The palm has come along: link 0 is the palm, and the object stays in it.
    T_palm_object = np.linalg.inv(motion.T_world_link[-1, 0]) @ motion.T_world_object[-1, 0]
    T_world_palm = shown.grasps.T_world_link[shown.selected, 0]
    planned_at = np.linalg.inv(T_world_palm) @ start
    assert np.linalg.norm(T_palm_object[:3, 3] - planned_at[:3, 3]) < 0.03


def test_a_grasp_that_cannot_be_planned_has_no_motion(evaluation, description_of_scene):
    scene = description_of_scene[0]
    found = evaluation.proposals(scene)
    below = dataclasses.replace(found, position=found.position - [0, 0, 0.2])
    motion = record_trial(evaluation.open(scene), evaluation.hand, below, 0, "below")
    assert motion.outcome == "plan: table"
    assert motion.phase == []
    objects = [evaluation.objects[name] for name in scene.object_ids]
    shown = data.scene_view(scene, objects, below, evaluation.hand, "t", motion=motion)
    told = page_data(shown)["motion"]
    assert told["T_world_link"]["shape"] == [0, evaluation.hand.links, 3, 4]
    assert told["T_world_object"]["shape"] == [0, 1, 3, 4]


def test_the_executed_grasp_is_selected(evaluation, description_of_scene):
    scene = description_of_scene[0]
    proposed = evaluation.proposals(scene)
    chosen = np.array([3, 1])
    assert view_scene._row(proposed, proposed[chosen], 0) == 3
    assert view_scene._row(proposed, proposed[chosen], 1) == 1


def test_grasps_of_a_scene_are_ranked(evaluation, description_of_scene):
    scene = description_of_scene[0]
    proposed = evaluation.proposals(scene)
    shuffled = GraspCandidates(
        **{
            **{f.name: getattr(proposed, f.name) for f in dataclasses.fields(proposed)},
            "confidence": np.random.default_rng(3).permutation(len(proposed)) / 10,
        }
    )
    model = [evaluation.objects[name] for name in scene.object_ids]
    shown = data.scene_view(scene, model, shuffled, evaluation.hand, "t", selected=2)
    assert (np.diff(shown.grasps.confidence) <= 0).all()
    palm = shown.grasps.T_world_link[shown.selected, 0]
    np.testing.assert_allclose(palm, shuffled.T[2], atol=1e-6)


def test_no_such_trial_is_said(evaluation, description_of_scene):
    with pytest.raises(DmfcError, match="no trial 99"):
        evaluated_view(evaluation, description_of_scene[0], 99, "planner")
