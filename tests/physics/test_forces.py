"""What drives the fingers and what rubs, against the MJCF and Coulomb."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from dmfc.config.physics import PhysicsConfig
from dmfc.hand.description import HandDescription
from dmfc.hand.mjcf import PREFIX, dof_actuators, hand_spec
from dmfc.physics.world import World
from tests.support.physics_shapes import GRAVITY, ball, block, place, pose, step


def test_gains_are_scaled_torque_limits_are_not(description: HandDescription) -> None:
    spec = hand_spec(description)
    names = dof_actuators(spec, description)
    stock = spec.compile()
    model = World(description, [], PhysicsConfig(gain_scale=3.0)).model
    for name in names:
        ours, theirs = model.actuator(name), stock.actuator(name)
        assert ours.gainprm[0] == pytest.approx(3.0 * theirs.gainprm[0])
        assert ours.biasprm[1] == pytest.approx(3.0 * theirs.biasprm[1])
        assert ours.biasprm[1] == -ours.gainprm[0]
        assert ours.forcelimited
        assert np.array_equal(ours.forcerange, theirs.forcerange)
        assert np.array_equal(ours.ctrlrange, theirs.ctrlrange)
    for row in range(1, stock.nbody):
        name = stock.body(row).name
        extra = PhysicsConfig().base_mass if name == PREFIX + description.palm else 0.0
        assert model.body(name).mass == pytest.approx(stock.body(row).mass + extra)


def test_every_object_and_actuator_can_be_given_the_same(description: HandDescription) -> None:
    physics = PhysicsConfig(object_mass=0.1, actuator_gain=5.0, actuator_limit=3.0)
    blocks = [block(mass=0.5), ball(mass=0.02)]
    world = World(description, blocks, physics)
    for k, given in enumerate(blocks):
        body = world.index.object_body[k]
        assert world.model.body_mass[body] == pytest.approx(0.1)
        assert world.objects[k].inertia / 0.1 == pytest.approx(given.inertia / given.mass)
    index = world.index.actuator
    assert (world.model.actuator_gainprm[index, 0] == 5.0).all()
    assert (world.model.actuator_biasprm[index, 1] == -5.0).all()
    assert (np.abs(world.model.actuator_forcerange[index]) == 3.0).all()


@pytest.mark.parametrize("weight", [True, False])
def test_fingers_without_force_fall_only_if_they_weigh(
    description: HandDescription, weight: bool
) -> None:
    physics = PhysicsConfig(gain_scale=0.0, hand_weight=weight)
    world = World(description, [block()], physics, table_size=2.0)
    place(world, [pose(z=0.5)], palm=pose(0.4, z=0.6, turn=(np.pi / 2, 0, 0)))
    before = world.joints()
    step(world, 0.3)
    fell = np.abs(world.joints() - before).max()
    assert fell > 0.1 if weight else fell < 0.01
    # Objects fall either way.
    assert world.object_pose(0)[2, 3] < 0.2


def test_torques_never_pass_the_limits_of_the_mjcf(still: World) -> None:
    lower, upper = still.dof_range.T
    limits = still.model.actuator_forcerange[still.index.actuator]
    for joints in (upper, lower):
        still.drive_joints(joints)
        for _ in range(20):
            mujoco.mj_step(still.model, still.data, 5)
            force = still.data.actuator_force[still.index.actuator]
            assert (force >= limits[:, 0] - 1e-9).all()
            assert (force <= limits[:, 1] + 1e-9).all()


def test_commands_of_coupled_joints_are_the_sum_of_both_angles(still: World) -> None:
    joints = np.linspace(0.1, 0.3, len(still.hand.dofs))
    still.drive_joints(joints)
    pairs = [name.endswith("J2") and "TH" not in name for name in still.hand.dofs]
    expected = np.where(pairs, 2 * joints, joints)
    assert still.data.ctrl[still.index.actuator] == pytest.approx(expected)


def test_friction_and_steps_are_the_settings(description: HandDescription) -> None:
    physics = PhysicsConfig(
        timestep=0.001,
        hand_friction=0.8,
        object_friction=0.3,
        impratio=7.0,
        torsional_friction=0.01,
    )
    world = World(description, [ball()], physics, table_size=1.0)
    owner, friction = world.index.geom_owner, world.model.geom_friction
    assert world.model.opt.timestep == 0.001
    assert world.model.opt.impratio == 7.0
    assert (friction[owner == -2, 0] == 0.8).all()
    assert (friction[owner != -2, 0] == 0.3).all()
    assert (friction[:, 1] == 0.01).all()
    assert (world.model.geom_condim[owner != -1] == 4).all()


def test_a_sliding_block_stops_where_coulomb_says(description: HandDescription) -> None:
    """Distance v^2 / (2 mu g), the friction of objects and table on each other."""
    mu, speed = 0.3, 1.0
    flat = block(mass=0.5, size=(0.12, 0.12, 0.03))
    world = World(description, [flat], PhysicsConfig(object_friction=mu), table_size=2.0)
    place(world, [pose(z=0.015)], palm=pose(0, 0.8, 0.8))
    step(world, 0.1)
    start = world.object_pose(0)[0, 3]
    world.data.qvel[world.index.object_qvel[0]] = speed
    step(world, 1.0)
    slid = world.object_pose(0)[0, 3] - start
    assert slid == pytest.approx(speed**2 / (2 * mu * GRAVITY), rel=0.05)
    assert abs(world.data.qvel[world.index.object_qvel[0]]) < 1e-3
