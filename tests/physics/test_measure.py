"""What is measured of a world, against closed forms and MuJoCo's own sums."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from dmfc.config.physics import PhysicsConfig
from dmfc.hand.description import HandDescription
from dmfc.physics.measure import (
    depths,
    kinetic_speed,
    saturated,
    supported,
    touch,
)
from dmfc.physics.world import World, pose_to_qpos
from tests.support.physics_shapes import (
    AWAY,
    GRAVITY,
    STANDING,
    ball,
    lopsided,
    place,
    pose,
    step,
)


def test_a_ball_presses_on_the_table_with_its_weight(description: HandDescription) -> None:
    heavy = ball(mass=0.7)
    world = World(description, [heavy], PhysicsConfig(), table_size=1.0)
    place(world, [pose(z=float(heavy.stable_heights[0]))])
    step(world, 0.5)
    contacts = world.data.ncon
    assert supported(world, 0)
    total = sum(contact_force(world, k)[0] for k in range(contacts))
    assert total == pytest.approx(0.7 * GRAVITY, rel=0.01)
    place(world, [pose(z=0.5)])
    mujoco.mj_forward(world.model, world.data)
    assert not supported(world, 0)


def test_a_played_command_is_a_step_and_its_peaks_are_those_of_every_contact(still: World) -> None:
    """Against Python's loop, bit by bit: blocks fall while the hand moves and closes."""
    steps = 60
    share = np.linspace(0, 1, steps)[:, None]
    poses = pose_to_qpos(AWAY) + share * [0.0, 0.1, -0.1, 0, 0, 0, 0]
    joints = still.hand.open_joints + share * still.hand.flexion_direction
    start = [pose(z=0.07), pose(-0.4, z=0.5)]

    place(still, start)
    gaps, forces = [0.0], [0.0]
    for target, angles in zip(poses, joints, strict=True):
        still.drive_palm(target)
        still.drive_joints(angles)
        mujoco.mj_step(still.model, still.data)
        gaps += still.data.contact.dist.tolist()
        forces += [np.linalg.norm(contact_force(still, k)) for k in range(still.data.ncon)]
    expected = still.data.qpos.copy(), still.data.qvel.copy(), still.data.time

    place(still, start)
    commands = still.commands(poses, joints)
    peaks = [still.play(commands[:25]), still.play(commands[25:])]
    assert np.array_equal(still.data.qpos, expected[0])
    assert np.array_equal(still.data.qvel, expected[1])
    assert still.data.time == expected[2]
    assert max(forces) > 5
    assert max(peak.force for peak in peaks) == pytest.approx(max(forces), rel=1e-9)
    assert max(peak.penetration for peak in peaks) == -min(gaps) > 0


def test_without_contacts_there_are_no_peaks(description: HandDescription) -> None:
    world = World(description, [ball()], PhysicsConfig())
    place(world, [pose(z=0.5)])
    peaks = world.play(world.commands(pose_to_qpos(AWAY)[None], world.joints()[None]))
    assert (peaks.force, peaks.penetration) == (0.0, 0.0)


def contact_force(world: World, number: int) -> np.ndarray:
    """Normal force of a contact and its friction, N, by MuJoCo's own function."""
    force = np.zeros(6)
    mujoco.mj_contactForce(world.model, world.data, number, force)
    return force[:3]


def test_kinetic_speed_is_that_of_mujocos_energy(description: HandDescription) -> None:
    wedge = lopsided(mass=0.4)
    world = World(description, [wedge], PhysicsConfig())
    generator = np.random.default_rng(0)
    for _ in range(5):
        place(world, [pose(0.1, 0.2, 1.0, tuple(generator.normal(size=3)))])
        first = world.index.object_qvel[0]
        world.data.qvel[first : first + 6] = generator.normal(size=6)
        mujoco.mj_forward(world.model, world.data)
        mujoco.mj_energyVel(world.model, world.data)
        expected = np.sqrt(2 * world.data.energy[1] / 0.4)
        assert kinetic_speed(world, 0) == pytest.approx(expected, rel=1e-6)


def test_depths_are_told_apart(still: World) -> None:
    place(still, [pose(z=0.059), pose(-0.4, z=0.06)])
    mujoco.mj_forward(still.model, still.data)
    assert still.contacts()[1].min() == pytest.approx(-0.001, abs=1e-6)
    assert depths(still, 0).table == 0.0  # it is the block that is in the table, not the hand
    middle = AWAY[:3, 3] + np.array(still.hand.palm_reference)
    place(still, [pose(*middle), pose(-0.4, z=0.06)])
    mujoco.mj_forward(still.model, still.data)
    target, other = depths(still, 0), depths(still, 1)
    assert target.target > 0.005
    assert (other.others, other.target) == (target.target, 0.0)
    assert touch(still, 0).links >= 1
    assert len(touch(still, 1)) == 0


def test_saturation_counts_the_actuators_at_their_limits(still: World) -> None:
    place(still, [STANDING, pose(-0.4, z=0.06)])
    step(still, 0.3)
    assert saturated(still) == 0.0
    limits = still.model.actuator_forcerange[still.index.actuator]
    still.data.actuator_force[still.index.actuator[:3]] = limits[:3, 1]
    still.data.actuator_force[still.index.actuator[3:5]] = limits[3:5, 0]
    assert saturated(still) == pytest.approx(5 / len(limits))
