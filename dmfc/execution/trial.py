"""One trial: plan, move, close, lift, hold; and the judgement.

Physics acts on the object from the first step to the last: it is never held, moved or reset by
anything but contacts and gravity.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import mujoco
import numpy as np

from dmfc.config.execution import ExecutionConfig
from dmfc.execution.trajectory import Trajectory, plan_trajectory
from dmfc.hand.model import HandModel
from dmfc.physics.world import World

REASONS = (
    "no candidate",
    "plan: table",
    "plan: object",
    "knocked away",
    "no lift",
    "dropped in lift",
    "dropped in hold",
    "diverged",
)
"""Why a trial failed; a trial that held has the empty reason."""

Observer = Callable[[str, World], None]
_LOOK = 0.05  # s between two looks at the state


@dataclass
class Outcome:
    """What is recorded of a trial; lengths in metres, angles in rad, times in seconds."""

    planned: bool = False
    held: bool = False
    reason: str = "no candidate"
    phase: str = ""
    """Phase in which the trial ended."""
    max_penetration: float = 0.0
    """Deepest hand-object penetration seen."""
    contacts: int = 0
    """Links of the hand that touched the object before the lift."""
    slip: float = 0.0
    """How far the object's centre moved in the palm's frame from the lift on."""
    turn: float = 0.0
    """How far the object turned in the palm's frame from the lift on."""
    pushed: float = 0.0
    """How far the object's centre moved in the world until the lift."""
    neighbour_moved: float = 0.0
    """Farthest that the centre of another object of the scene moved."""
    simulated: float = 0.0
    """Simulated time."""


class TrialRunner:
    """Runs the trials of one scene; the model is compiled once and reset by state."""

    def __init__(
        self, world: World, hand: HandModel, T_world_object: np.ndarray, config: ExecutionConfig
    ) -> None:
        """`world` has a table and the scene's objects; they come to rest at once."""
        self.world, self.hand, self.config = world, hand, config
        self.timestep = world.model.opt.timestep
        world.reset()
        away = np.eye(4)
        away[2, 3] = 2.0
        world.place_palm(away, world.hand.open_joints)
        for k, T in enumerate(T_world_object):
            world.place_object(k, T)
        mujoco.mj_step(world.model, world.data, max(1, round(config.settle_time / self.timestep)))
        self._rest = mujoco.MjData(world.model)
        mujoco.mj_copyData(self._rest, world.model, world.data)
        self._rest_poses = [world.object_pose(k) for k in range(len(world.objects))]

    def run(
        self,
        T_world_palm: np.ndarray,
        joints: np.ndarray,
        target: int,
        observer: Observer | None = None,
    ) -> Outcome:
        """Execute a grasp [4, 4], [D] on object `target`; `observer` is called at every look."""
        trajectory = plan_trajectory(T_world_palm, joints, self.hand, self.config)
        outcome = Outcome()
        outcome.reason = self._plan(trajectory, target)
        outcome.planned = not outcome.reason
        if outcome.planned:
            self._execute(trajectory, target, outcome, observer)
        return outcome

    # ── plan ─────────────────────────────────────────────────────────────────────────────────

    def _plan(self, trajectory: Trajectory, target: int) -> str:
        """Reason why the motion does not fit, or the empty string; no physics is stepped.

        The open hand is checked from the pre-grasp to the grasp pose, then the closed hand there.
        """
        config = self.config
        pre, grasp = trajectory.T_pregrasp, trajectory.T_grasp
        for share in np.linspace(0.0, 1.0, config.waypoints):
            T = grasp.copy()
            T[:3, 3] = pre[:3, 3] + share * (grasp[:3, 3] - pre[:3, 3])
            table, grasped, others = self._depths(T, trajectory.opened, target)
            if table > config.approach_tolerance:
                return "plan: table"
            if max(grasped, others) > config.approach_tolerance:
                return "plan: object"
        table, grasped, others = self._depths(grasp, trajectory.closed, target)
        if table > config.approach_tolerance:
            return "plan: table"
        deep = grasped > config.grasp_tolerance or others > config.approach_tolerance
        return "plan: object" if deep else ""

    def _depths(
        self, T_world_palm: np.ndarray, joints: np.ndarray, target: int
    ) -> tuple[float, float, float]:
        """Penetration of the hand with the table, the target and any other object, metres."""
        world = self.world
        self._reset()
        world.place_palm(T_world_palm, joints)
        mujoco.mj_kinematics(world.model, world.data)
        mujoco.mj_collision(world.model, world.data)
        owners, gaps = world.contacts()
        hand, owner = owners.min(axis=1) == -2, owners.max(axis=1)

        def deepest(mask: np.ndarray) -> float:
            return float(-gaps[hand & mask].min(initial=0.0))

        return (
            deepest(owner == -1),
            deepest(owner == target),
            deepest((owner >= 0) & (owner != target)),
        )

    def _reset(self) -> None:
        mujoco.mj_copyData(self.world.data, self.world.model, self._rest)

    # ── execute ──────────────────────────────────────────────────────────────────────────────

    def _execute(
        self, trajectory: Trajectory, target: int, outcome: Outcome, observer: Observer | None
    ) -> None:
        """Step through the phases until the end, or until the object is lost."""
        world, config = self.world, self.config
        self._reset()
        world.place_palm(trajectory.T_rest, trajectory.opened)
        watch = _Watch(world, target, self._rest_poses, config, outcome)
        for phase in trajectory.phases:
            outcome.phase = phase.name
            if phase.name == "lift":
                watch.begin_lift(trajectory.T_lifted[2, 3] - trajectory.T_grasp[2, 3])
                if outcome.reason:
                    return
            poses, joints = phase.commands(self.timestep)
            look = max(1, round(_LOOK / self.timestep))
            for step, (pose, angles) in enumerate(zip(poses, joints, strict=True)):
                world.drive_palm(pose)
                world.drive_joints(angles)
                mujoco.mj_step(world.model, world.data)
                if step % look == look - 1 or step == len(poses) - 1:
                    if observer:
                        observer(phase.name, world)
                    watch.look(phase.name)
                    if outcome.reason:
                        return
            if phase.name == "lift":
                watch.end_lift()
                if outcome.reason:
                    return
        watch.end()


class _Watch:
    """Looks at the object during a trial and writes what it sees into the outcome."""

    def __init__(
        self,
        world: World,
        target: int,
        rest_poses: list[np.ndarray],
        config: ExecutionConfig,
        outcome: Outcome,
    ) -> None:
        self.world, self.target, self.config, self.outcome = world, target, config, outcome
        self.rest_poses = rest_poses
        self.centre = np.append(world.objects[target].com, 1.0)
        self.rise = 0.0
        self.best_height = 0.0
        self.last_touch = 0.0
        self.start_time = world.data.time
        self.T_palm_object: np.ndarray | None = None

    def look(self, phase: str) -> None:
        """Every 50 ms: divergence, penetration, neighbours, whether the object is still there."""
        world, outcome = self.world, self.outcome
        outcome.simulated = world.data.time - self.start_time
        if world.diverged():
            outcome.reason = "diverged"
            return
        touching, depth = self._touch()
        outcome.max_penetration = max(outcome.max_penetration, depth)
        for k, rest in enumerate(self.rest_poses):
            if k != self.target:
                moved = (world.object_pose(k) - rest) @ np.append(world.objects[k].com, 1.0)
                outcome.neighbour_moved = max(
                    outcome.neighbour_moved, float(np.linalg.norm(moved[:3]))
                )
        height = self._height()
        self.best_height = max(self.best_height, height)
        if touching:
            self.last_touch = world.data.time
        if self.T_palm_object is not None:
            self._follow()
            if world.data.time - self.last_touch > self.config.lost_time:
                outcome.reason = self._lost(phase)

    def begin_lift(self, rise: float) -> None:
        """Before the lift: was the object pushed away?"""
        self.rise = rise
        moved = self.world.object_pose(self.target) - self.rest_poses[self.target]
        self.outcome.pushed = float(np.linalg.norm((moved @ self.centre)[:3]))
        self.outcome.contacts = len(self._links())
        self.last_touch = self.world.data.time
        if self.outcome.pushed > self.config.knock_distance:
            self.outcome.reason = "knocked away"
        self.T_palm_object = np.linalg.inv(self.world.palm_pose()) @ self.world.object_pose(
            self.target
        )

    def end_lift(self) -> None:
        """After the lift the object must have come along."""
        if self._height() < self.config.lift_fraction * self.rise:
            self.outcome.reason = self._lost("lift")

    def end(self) -> None:
        """After the hold: in the hand, near the palm, off the table and off its neighbours."""
        outcome = self.outcome
        palm = self.world.palm_pose()[:3, 3]
        near = np.linalg.norm(self._position() - palm) <= self.config.palm_distance
        supported = self._supported()
        high = self._height() >= self.config.lift_fraction * self.rise
        outcome.held = bool(len(self._links()) and near and high and not supported)
        outcome.reason = "" if outcome.held else "dropped in hold"

    def _lost(self, phase: str) -> str:
        if phase == "hold":
            return "dropped in hold"
        lifted = self.best_height > max(0.02, 0.1 * self.rise)
        return "dropped in lift" if lifted else "no lift"

    def _follow(self) -> None:
        now = np.linalg.inv(self.world.palm_pose()) @ self.world.object_pose(self.target)
        start, outcome = self.T_palm_object, self.outcome
        assert start is not None
        slip = float(np.linalg.norm(((now - start) @ self.centre)[:3]))
        cosine = (np.trace(start[:3, :3].T @ now[:3, :3]) - 1) / 2
        outcome.slip = max(outcome.slip, slip)
        outcome.turn = max(outcome.turn, float(np.arccos(np.clip(cosine, -1, 1))))

    def _position(self) -> np.ndarray:
        return (self.world.object_pose(self.target) @ self.centre)[:3]

    def _height(self) -> float:
        """How far the object's centre is above where it rested, metres."""
        return float(self._position()[2] - (self.rest_poses[self.target] @ self.centre)[2])

    def _touch(self) -> tuple[bool, float]:
        owners, gaps = self.world.contacts()
        ours = (owners.min(axis=1) == -2) & (owners.max(axis=1) == self.target)
        return bool(ours.any()), float(-gaps[ours].min(initial=0.0))

    def _links(self) -> np.ndarray:
        owners, _ = self.world.contacts()
        geoms = self.world.data.contact.geom
        ours = (owners.min(axis=1) == -2) & (owners.max(axis=1) == self.target)
        hand = geoms[ours][owners[ours] == -2]
        return np.unique(self.world.model.geom_bodyid[hand])

    def _supported(self) -> bool:
        """Whether the object touches the table or another object."""
        owners, _ = self.world.contacts()
        ours = (owners == self.target).any(axis=1)
        return bool(((owners >= -1) & (owners != self.target))[ours].any())
