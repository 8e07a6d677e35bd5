"""Trials: what holds is held, what cannot be held never is, and every failure has its reason."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import mujoco
import numpy as np
import pytest

from dmfc.config.execution import ExecutionConfig
from dmfc.config.physics import PhysicsConfig
from dmfc.execution.outcome import REASONS, Outcome
from dmfc.execution.trial import TrialRunner
from dmfc.execution.watch import Watch
from dmfc.hand.model import HandModel
from dmfc.physics.measure import touch
from dmfc.physics.world import World
from tests.support.execution_shapes import good, runner, standing
from tests.support.grasp_shapes import FRICTIONLESS, depth_in_block, heavy, planned, shape
from tests.support.physics_shapes import pose

HIGH = pose(z=0.3)


@pytest.fixture(scope="module")
def block_runner(hand: HandModel) -> TrialRunner:
    return runner([shape("block")], [standing("block")])


def run(
    trials: TrialRunner,
    name: str,
    row: int,
    shift: np.ndarray | None = None,
    observer: Callable[[str, World], None] | None = None,
    T_world_object: np.ndarray | None = None,
) -> Outcome:
    """Execute the good grasp number `row`, the hand moved by `shift` [4, 4] in the world."""
    grasps = planned(name)
    T = standing(name) if T_world_object is None else T_world_object
    row = good(name)[row]
    T_world_palm = (np.eye(4) if shift is None else shift) @ T @ grasps.T_object_palm[row]
    outcome = trials.run(T_world_palm, grasps.joints[row], 0, observer)
    assert outcome.held == (outcome.reason == "")
    assert outcome.held or outcome.reason in REASONS
    assert outcome.planned == (
        outcome.reason not in ("no candidate", "plan: table", "plan: object")
    )
    assert outcome.planned or not outcome.held
    return outcome


# ── a grasp that holds ───────────────────────────────────────────────────────────────────────────


@pytest.mark.parametrize("name", ["block", "ball"])
def test_planned_grasps_are_held_to_the_end(hand: HandModel, name: str) -> None:
    """From an object turned about the vertical and away from the centre of the table."""
    assert len(good(name)) >= 0.6 * len(planned(name))
    T, config = standing(name, 0.06, -0.04, turn=1.0), ExecutionConfig()
    trials = runner([shape(name)], [T])
    heights: list[float] = []

    def look(phase: str, world: World) -> None:
        if phase == "hold":
            owners, _ = world.contacts()
            assert not ((owners.min(axis=1) == -1) & (owners.max(axis=1) == 0)).any()
            heights.append(world.object_pose(0)[2, 3])

    outcomes = [run(trials, name, row, observer=look, T_world_object=T) for row in range(3)]
    held = [outcome for outcome in outcomes if outcome.held]
    assert len(held) >= 2
    for outcome in held:
        assert (outcome.phase, outcome.reason) == ("hold", "")
        assert outcome.contacts >= 1
        assert outcome.hand_penetration < 0.004
        assert outcome.lift_slip < 0.05
        assert outcome.hold_slip < 0.01
        assert outcome.pushed < config.knock_distance
        assert outcome.neighbour_moved == 0.0
        assert sum(outcome.seconds.values()) == pytest.approx(4.8)
    # The object is really up in the air, not just called held.
    assert np.median(heights) > 0.15


def test_a_trial_is_the_same_alone_and_after_others(
    hand: HandModel, block_runner: TrialRunner
) -> None:
    alone = run(runner([shape("block")], [standing("block")]), "block", 1)
    run(block_runner, "block", 0)
    run(block_runner, "block", 2, shift=pose(x=0.01))
    assert run(block_runner, "block", 1) == alone
    assert run(block_runner, "block", 1) == alone


# ── what can never be held ───────────────────────────────────────────────────────────────────────


def test_a_hand_beside_or_above_the_object_holds_nothing(block_runner: TrialRunner) -> None:
    for shift in (pose(x=0.35), pose(y=-0.35), HIGH):
        for row in range(3):
            outcome = run(block_runner, "block", row, shift=shift)
            assert not outcome.held
            assert outcome.contacts == 0
            if outcome.planned:
                assert outcome.reason == "no lift"
                assert outcome.pushed < 2e-3


@pytest.mark.parametrize("name", ["block", "ball"])
def test_fingers_without_force_never_lift(hand: HandModel, name: str) -> None:
    trials = runner([shape(name)], [standing(name)], PhysicsConfig(gain_scale=0.0))
    assert not trials.world.model.actuator_gainprm[:, 0].any()
    never_lifted(trials, name)


@pytest.mark.parametrize("name", ["block", "ball"])
def test_fifty_kilograms_are_never_lifted(hand: HandModel, name: str) -> None:
    never_lifted(runner([heavy(shape(name))], [standing(name)]), name)


def test_without_friction_a_ball_is_never_held_from_above(hand: HandModel) -> None:
    """The same grasps hold it with friction: see above."""
    downwards = (planned("ball").rotation @ hand.palm_normal)[good("ball"), 2]
    assert (downwards < -0.5).sum() >= 2
    never_lifted(runner([shape("ball")], [standing("ball")], FRICTIONLESS), "ball")


def never_lifted(trials: TrialRunner, name: str) -> None:
    rest = trials.world.object_pose(0)[2, 3]

    def look(phase: str, world: World) -> None:
        if phase in ("lift", "hold"):
            highest.append(world.object_pose(0)[2, 3] - rest)

    assert len(good(name)) >= 3
    for row in range(len(good(name))):
        highest: list[float] = [0.0]
        outcome = run(trials, name, row, observer=look)
        assert not outcome.held
        assert outcome.reason in ("no lift", "knocked away", "dropped in lift")
        assert max(highest) < 0.06


def test_a_scene_at_rest_stays_at_rest(block_runner: TrialRunner) -> None:
    moved: list[float] = []

    def look(phase: str, world: World) -> None:
        moved.append(float(np.linalg.norm((world.object_pose(0) - standing("block"))[:3, 3])))

    # The hand goes through the whole motion, half a metre away.
    outcome = run(block_runner, "block", 0, shift=pose(x=0.5), observer=look)
    assert outcome.planned
    assert max(moved) < 1e-3


# ── planning ─────────────────────────────────────────────────────────────────────────────────────


def test_a_hand_in_the_table_is_not_planned(block_runner: TrialRunner) -> None:
    outcome = run(block_runner, "block", 0, shift=pose(x=0.4, z=-0.25))
    assert outcome == Outcome(reason="plan: table", plan_depth=outcome.plan_depth)
    assert outcome.plan_depth > block_runner.config.approach_tolerance


def test_a_hand_in_an_object_is_not_planned(hand: HandModel, block_runner: TrialRunner) -> None:
    grasps = planned("block")[good("block")]
    for row in range(3):
        normal = grasps.rotation[row] @ hand.palm_normal
        outcome = run(block_runner, "block", row, shift=pose(*(0.08 * normal)))
        assert outcome.reason in ("plan: object", "plan: table")
    sideways = int(np.argmin(np.abs((grasps.rotation @ hand.palm_normal)[:, 2])))
    normal = grasps.rotation[sideways] @ hand.palm_normal
    outcome = run(block_runner, "block", sideways, shift=pose(*(0.08 * normal)))
    assert outcome == Outcome(reason="plan: object", plan_depth=outcome.plan_depth)


def test_a_neighbour_in_the_way_is_an_object_too(hand: HandModel) -> None:
    grasps = planned("block")[good("block")]
    row = int(np.argmin(np.abs((grasps.rotation @ hand.palm_normal)[:, 2])))
    palm = grasps.position[row] + grasps.rotation[row] @ hand.palm_reference
    behind = pose(palm[0], palm[1], 0.06)
    both = runner([shape("block"), shape("block")], [standing("block"), behind])
    assert run(both, "block", row).reason == "plan: object"
    apart = runner([shape("block"), shape("block")], [standing("block"), pose(0.6, 0.6, 0.06)])
    outcome = run(apart, "block", row)
    assert outcome.planned
    assert outcome.neighbour_moved < 1e-3


def test_planning_does_not_step_the_physics(block_runner: TrialRunner) -> None:
    before = block_runner.world.data.time
    run(block_runner, "block", 0, shift=pose(x=0.4, z=-0.25))
    block_runner._reset()
    assert block_runner.world.data.time <= before
    assert block_runner.world.data.time == pytest.approx(block_runner.config.settle_time)


def test_tolerances_are_settings(hand: HandModel) -> None:
    strict = dataclasses.replace(ExecutionConfig(), grasp_tolerance=-0.001)
    outcome = run(runner([shape("block")], [standing("block")], config=strict), "block", 0)
    assert outcome.reason == "plan: object"


# ── reasons ──────────────────────────────────────────────────────────────────────────────────────


def without_friction(phase: str) -> Callable[[str, World], None]:
    """An observer that takes all friction away once `phase` is under way."""

    def act(now: str, world: World) -> None:
        if now == phase:
            world.model.geom_friction[:] = 1e-5

    return act


@pytest.mark.parametrize("phase", ["lift", "hold"])
def test_an_object_that_slips_out_was_dropped_in_that_phase(hand: HandModel, phase: str) -> None:
    outcome = run(runner([shape("ball")], [standing("ball")]), "ball", 0, observer=late(phase))
    assert outcome.reason == f"dropped in {phase}"
    assert outcome.phase == phase
    assert max(outcome.lift_slip, outcome.hold_slip) > 0.01


def late(phase: str) -> Callable[[str, World], None]:
    """As `without_friction`, from a third of the phase on, when the object is in the air."""
    act, looks = without_friction(phase), 0

    def observe(now: str, world: World) -> None:
        nonlocal looks
        looks += now == phase
        if looks > 3:
            act(now, world)

    return observe


def test_an_object_tipped_up_on_its_edge_was_not_lifted(block_runner: TrialRunner) -> None:
    """A lying block, the palm on its upper side: tipped up, and in the air."""
    world = block_runner.world
    lying, tipped = pose(z=0.025, turn=(0, np.pi / 2, 0)), pose(z=0.0575, turn=(0, 0.87, 0))
    for T, lifted in ((tipped, False), (pose(z=0.0575, turn=(0, np.pi / 2, 0)), True)):
        block_runner._reset()
        world.place_object(0, T)
        T_world_palm = T @ pose(x=-0.045)
        T_world_palm[:3, 3] -= T_world_palm[:3, :3] @ world.hand.palm_reference
        world.place_palm(T_world_palm, world.hand.open_joints)
        mujoco.mj_forward(world.model, world.data)
        watch = Watch(world, 0, [lying], ExecutionConfig(), Outcome())
        watch.begin_lift(0.3)
        watch.look("lift")
        assert watch.outcome.hand_penetration > 0
        assert watch.lifted == lifted


def test_an_object_put_back_on_the_table_is_not_held(hand: HandModel) -> None:
    def act(phase: str, world: World) -> None:
        if phase == "hold":
            world.place_object(0, pose(0.5, 0.5, 0.06))

    outcome = run(runner([shape("block")], [standing("block")]), "block", 0, observer=act)
    assert outcome.reason == "dropped in hold"


def test_an_object_pushed_too_far_was_knocked_away(hand: HandModel) -> None:
    def act(phase: str, world: World) -> None:
        if phase == "approach":
            world.place_object(0, pose(0.4, 0.4, 0.06))

    outcome = run(runner([shape("block")], [standing("block")]), "block", 0, observer=act)
    assert (outcome.reason, outcome.phase) == ("knocked away", "approach")
    assert "close" not in outcome.seconds  # what is lost is not played to the end
    assert outcome.pushed == pytest.approx(0.4 * np.sqrt(2), abs=0.02)


@pytest.mark.parametrize("phase", ["approach", "hold"])
def test_a_simulation_that_breaks_is_a_failure(hand: HandModel, phase: str) -> None:
    def act(now: str, world: World) -> None:
        if now == phase:
            world.data.qvel[world.index.object_qvel[0]] = np.nan

    trials = runner([shape("block")], [standing("block")])
    outcome = run(trials, "block", 0, observer=act)
    assert (outcome.planned, outcome.held, outcome.reason) == (True, False, "diverged")
    assert run(trials, "block", 0).reason != "diverged"


def test_an_object_that_flies_off_is_a_broken_simulation(hand: HandModel) -> None:
    def act(now: str, world: World) -> None:
        if now == "hold":
            world.data.qvel[world.index.object_qvel[0] + 2] = 30.0

    outcome = run(runner([shape("block")], [standing("block")]), "block", 0, observer=act)
    assert outcome.reason == "diverged"
    assert outcome.kinetic_speed > 10.0


def test_contacts_at_the_grasp_are_on_the_block_and_point_out_of_it(
    block_runner: TrialRunner,
) -> None:
    """The block is a box: its surface and its normals are known."""
    found: list[tuple[np.ndarray, np.ndarray]] = []

    def look(phase: str, world: World) -> None:
        if phase == "squeeze":
            T, seen = world.object_pose(0), touch(world, 0)
            found.append(((seen.position - T[:3, 3]) @ T[:3, :3], seen.outward @ T[:3, :3]))

    outcome = run(block_runner, "block", 0, observer=look)
    assert 0 < outcome.q1 < 2
    position, outward = found[-1]
    assert len(position) >= outcome.contacts >= 2
    assert np.abs(depth_in_block(position)).max() < 1e-3
    # Just outside along the normal, just inside against it.
    assert (depth_in_block(position + 0.003 * outward) < 0).all()
    assert (depth_in_block(position - 0.003 * outward) > 0).all()


def test_steadiness_in_the_hand_can_be_asked_for(
    hand: HandModel, block_runner: TrialRunner
) -> None:
    free = run(block_runner, "block", 0)
    slip = max(free.lift_slip, free.hold_slip)
    for limit, reason in ((0.5 * slip, "dropped in hold"), (3 * slip, "")):
        config = dataclasses.replace(ExecutionConfig(), max_slip=limit)
        strict = runner([shape("block")], [standing("block")], config=config)
        assert run(strict, "block", 0).reason == reason


def test_a_row_has_the_same_columns_whatever_happened(block_runner: TrialRunner) -> None:
    nothing = Outcome().row()
    full = run(block_runner, "block", 0).row()
    assert list(nothing) == list(full)
    assert {"seconds_raise", "seconds_hold"} < set(full)
    assert sum(value for name, value in nothing.items() if name.startswith("seconds_")) == 0


def test_a_neighbour_that_is_moved_is_recorded(hand: HandModel) -> None:
    def act(phase: str, world: World) -> None:
        if phase == "lift":
            world.place_object(1, pose(0.5, 0.0, 0.06))

    models = [shape("block"), shape("block")]
    trials = runner(models, [standing("block"), pose(0.6, 0.0, 0.06)])
    outcome = run(trials, "block", 2, observer=act)
    assert outcome.neighbour_moved == pytest.approx(0.1, abs=5e-3)


def test_nothing_outside_physics_acts_on_the_object(hand: HandModel) -> None:
    """Between two looks its speed changes only by what contacts and gravity can do to it."""
    trials = runner([shape("block")], [standing("block")])
    model = trials.world.model
    assert not model.dof_armature[trials.world.index.object_qvel[0] :][:6].any()
    weld = model.eq_type == mujoco.mjtEq.mjEQ_WELD
    assert weld.sum() == 1

    def look(phase: str, world: World) -> None:
        first = world.index.object_qvel[0]
        assert not world.data.xfrc_applied.any()
        assert not world.data.qfrc_applied[first : first + 6].any()
        assert not world.data.qfrc_actuator[first : first + 6].any()
        assert np.array_equal(model.opt.gravity, [0, 0, -9.81])

    run(trials, "block", 0, observer=look)
