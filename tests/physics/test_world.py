"""The simulated world against closed forms, the MJCF and the project's own kinematics."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import mujoco
import numpy as np
import pytest
import torch

from dmfc.config.hand import HandConfig
from dmfc.config.physics import PhysicsConfig
from dmfc.hand.build import build_hand
from dmfc.hand.description import HandDescription
from dmfc.hand.kinematics import HandKinematics
from dmfc.hand.mjcf import PREFIX
from dmfc.physics.world import World, pose_to_qpos, qpos_to_pose
from tests.support.physics_shapes import (
    AWAY,
    GRAVITY,
    STANDING,
    angle,
    lopsided,
    place,
    pose,
    random_pose,
    step,
)


@pytest.fixture(scope="module")
def floating(description: HandDescription) -> Iterator[World]:
    """One wedge that can be held, no table."""
    world = World(description, [lopsided()], PhysicsConfig())
    assert world.model.opt.gravity[2] == -GRAVITY
    return world


# ── frames ───────────────────────────────────────────────────────────────────────────────────────


def test_quaternions_are_w_first_and_poses_round_trip() -> None:
    assert pose_to_qpos(pose(1, 2, 3, (0, 0, np.pi / 2))) == pytest.approx(
        [1, 2, 3, np.sqrt(0.5), 0, 0, np.sqrt(0.5)]
    )
    generator = np.random.default_rng(0)
    for _ in range(20):
        T = random_pose(generator)
        assert qpos_to_pose(pose_to_qpos(T)) == pytest.approx(T, abs=1e-12)


def test_links_are_where_the_kinematics_put_them(world: World, shadow_hand_dir: Path) -> None:
    hand = build_hand(HandConfig(link_sdf_spacing=0.01, collision_points=500))
    kinematics, generator = HandKinematics(hand), np.random.default_rng(1)
    assert pytest.approx(np.stack([hand.lower, hand.upper]), abs=1e-5) == world.dof_range.T
    for _ in range(20):
        T, joints = random_pose(generator), generator.uniform(hand.lower, hand.upper)
        world.reset()
        world.place_palm(T, joints)
        mujoco.mj_kinematics(world.model, world.data)
        assert world.palm_pose() == pytest.approx(T, abs=1e-12)
        assert np.array_equal(world.joints(), joints)
        links = kinematics.links(torch.as_tensor(T)[None], torch.as_tensor(joints)[None])[0]
        for name, expected in zip(hand.link_names, links.numpy(), strict=True):
            found = world.data.body(PREFIX + name)
            assert found.xpos == pytest.approx(expected[:3, 3], abs=1e-6), name
            assert found.xmat == pytest.approx(expected[:3, :3].ravel(), abs=1e-6), name


def test_an_object_is_where_it_is_put_mass_and_all(floating: World) -> None:
    model, data, wedge = floating.model, floating.data, floating.objects[0]
    T = random_pose(np.random.default_rng(2))
    place(floating, [T])
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    assert floating.object_pose(0) == pytest.approx(T, abs=1e-12)
    body = floating.index.object_body[0]
    R_world_object = T[:3, :3]
    assert data.xipos[body] == pytest.approx(R_world_object @ wedge.com + T[:3, 3], abs=1e-9)
    assert model.body_mass[body] == pytest.approx(wedge.mass)
    axes = data.ximat[body].reshape(3, 3)
    inertia = axes @ np.diag(model.body_inertia[body]) @ axes.T
    expected = R_world_object @ wedge.inertia @ R_world_object.T
    assert inertia == pytest.approx(expected, rel=1e-6, abs=1e-9)
    # MuJoCo moves a mesh to its own centre; what collides must stay where it was all the same.
    geom = int(np.flatnonzero(floating.index.geom_owner == 0)[0])
    mesh = model.geom_dataid[geom]
    first, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
    corners = model.mesh_vert[first : first + count] @ data.geom_xmat[geom].reshape(3, 3).T
    found = corners + data.geom_xpos[geom]
    wanted = wedge.vertices @ R_world_object.T + T[:3, 3]
    gaps = np.linalg.norm(found[:, None] - wanted[None], axis=2)
    assert gaps.min(axis=0).max() < 1e-6


# ── gravity and rest ─────────────────────────────────────────────────────────────────────────────


def test_a_block_at_rest_stays_at_rest(still: World) -> None:
    for _ in range(4):
        step(still, 0.5)
        moved = still.object_pose(0) - STANDING
        assert np.linalg.norm(moved[:3, 3]) < 1e-3
        assert angle(still.object_pose(0), STANDING) < 0.01
    assert not still.diverged()


def test_free_fall_and_the_hand_does_not_follow(floating: World) -> None:
    start = random_pose(np.random.default_rng(3))
    place(floating, [start])
    centre = np.append(floating.objects[0].com, 1.0)
    timestep = floating.model.opt.timestep
    for seconds in (0.1, 0.2, 0.3):
        step(floating, 0.1)
        fallen = (start - floating.object_pose(0)) @ centre
        # The integrator is of first order: it is off by half a step's speed.
        assert fallen[2] == pytest.approx(
            GRAVITY * seconds**2 / 2, abs=GRAVITY * seconds * timestep
        )
        assert fallen[:2] == pytest.approx([0, 0], abs=1e-6)
        assert angle(floating.object_pose(0), start) < 1e-6
    assert np.linalg.norm(floating.palm_pose()[:3, 3] - AWAY[:3, 3]) < 5e-4


def test_the_palm_does_not_sag_and_follows_its_target(still: World) -> None:
    step(still, 0.5)
    assert np.linalg.norm(still.palm_pose()[:3, 3] - AWAY[:3, 3]) < 5e-4
    assert angle(still.palm_pose(), AWAY) < 5e-3
    goal = pose(0.3, 0.1, 0.8, (0.0, 0.6, 0.0))
    for share in np.linspace(0, 1, 251)[1:]:
        target = pose(0.4 - 0.1 * share, 0.1 * share, 0.6 + 0.2 * share, (0.0, 0.6 * share, 0.0))
        still.drive_palm(pose_to_qpos(target))
        mujoco.mj_step(still.model, still.data)
        assert np.linalg.norm(still.palm_pose()[:3, 3] - target[:3, 3]) < 0.02
    step(still, 0.3)
    assert np.linalg.norm(still.palm_pose()[:3, 3] - goal[:3, 3]) < 5e-4
    assert angle(still.palm_pose(), goal) < 5e-3


def test_fingers_go_where_they_are_driven(still: World) -> None:
    joints = still.hand.open_joints + 0.4 * still.hand.flexion_direction
    still.drive_joints(joints)
    step(still, 1.0)
    assert still.joints() == pytest.approx(joints, abs=0.05)
    index = still.index
    followers = still.data.qpos[index.follower_qpos]
    assert followers == pytest.approx(
        still.joints()[index.follower_of] * index.follower_ratio, abs=0.01
    )


# ── what acts on what ────────────────────────────────────────────────────────────────────────────


def test_nothing_ties_an_object_to_anything(still: World) -> None:
    model = still.model
    objects = {int(body) for body in still.index.object_body}
    welds = []
    for row in range(model.neq):
        first, second = int(model.eq_obj1id[row]), int(model.eq_obj2id[row])
        if model.eq_type[row] == mujoco.mjtEq.mjEQ_JOINT:
            joined = {int(model.jnt_bodyid[first]), int(model.jnt_bodyid[second])}
            assert not joined & objects
        else:
            assert model.eq_type[row] == mujoco.mjtEq.mjEQ_WELD
            welds.append({model.body(first).name, model.body(second).name})
    assert welds == [{"palm_target", PREFIX + still.hand.palm}]
    for body in objects:
        assert model.body_parentid[body] == 0
        assert model.body_jntnum[body] == 1
        assert model.jnt_type[model.body_jntadr[body]] == mujoco.mjtJoint.mjJNT_FREE
        assert model.body_gravcomp[body] == 0
        assert model.body_dofnum[body] == 6
        dofs = slice(model.body_dofadr[body], model.body_dofadr[body] + 6)
        assert not model.dof_damping[dofs].any()
        assert not model.dof_frictionloss[dofs].any()
        assert not model.dof_armature[dofs].any()
    driven = [model.actuator(row).trnid[0] for row in range(model.nu)]
    assert len(driven) == len(still.hand.dofs)
    assert not still.data.xfrc_applied.any()
    assert not still.data.qfrc_applied.any()


def test_hold_keeps_it_where_it_is_and_lets_go(floating: World) -> None:
    """With an inertia M of its own and a force F on it, it moves by F t^2 / 2 M."""
    start = random_pose(np.random.default_rng(4))
    place(floating, [start])
    floating.hold(0, 1e4)
    first = floating.index.object_qvel[0]
    floating.data.qfrc_applied[first : first + 3] = [0.0, 20.0, 0.0]
    step(floating, 0.5)
    held, body = floating.object_pose(0), floating.objects[0]
    centre = np.append(body.com, 1.0)
    moved = ((held - start) @ centre)[:3]
    assert moved == pytest.approx(np.array([0.0, 20.0, -GRAVITY * body.mass]) * 0.125e-4, abs=5e-6)
    assert angle(held, start) < 1e-3
    floating.data.qfrc_applied[:] = 0.0
    floating.hold(0, 0.0)
    assert not floating.data.qvel[first : first + 6].any()
    step(floating, 0.2)
    fallen = ((held - floating.object_pose(0)) @ centre)[2]
    assert fallen == pytest.approx(GRAVITY * 0.2**2 / 2, rel=0.05)


def test_a_reset_lets_go(floating: World) -> None:
    floating.hold(0, 1e4)
    floating.reset()
    assert not floating.model.dof_armature[floating.index.object_qvel[0] :][:6].any()


def test_contacts_name_their_owners(still: World) -> None:
    def pairs() -> set[tuple[int, int]]:
        mujoco.mj_forward(still.model, still.data)
        owners, _ = still.contacts()
        return {(min(pair), max(pair)) for pair in owners.tolist()}

    place(still, [pose(z=0.059), pose(-0.4, z=0.5)])
    assert pairs() == {(-1, 0)}
    owners, gaps = still.contacts()
    assert len(owners) == len(gaps) == 4
    assert gaps == pytest.approx(-0.001, abs=1e-6)
    place(still, [pose(z=0.059), pose(z=0.178)])
    assert pairs() == {(-1, 0), (0, 1)}
    place(still, [pose(z=0.5), pose(-0.4, z=0.5)], palm=pose(0.4, 0, 0.005, (np.pi / 2, 0, 0)))
    assert pairs() == {(-2, -1)}
    # A palm whose reference point is in the middle of the second block.
    middle = AWAY[:3, 3] + np.array(still.hand.palm_reference)
    place(still, [pose(z=0.5), pose(*middle)])
    assert pairs() == {(-2, 1)}


def test_divergence_is_seen_and_forgotten_after_a_reset(still: World) -> None:
    step(still, 0.01)
    assert not still.diverged()
    still.data.qpos[still.index.object_qpos[0]] = np.nan
    assert still.diverged()
    # MuJoCo sets a broken state back by itself; it still counts as broken.
    mujoco.mj_step(still.model, still.data)
    assert np.isfinite(still.data.qpos).all()
    assert still.diverged()
    place(still, [STANDING, pose(-0.4, z=0.06)])
    step(still, 0.01)
    assert not still.diverged()


def test_blocks_of_one_scene_collide_with_each_other(still: World) -> None:
    place(still, [STANDING, pose(z=0.20)])
    step(still, 0.5)
    assert still.object_pose(1)[2, 3] == pytest.approx(0.18, abs=2e-3)
