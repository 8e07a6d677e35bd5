"""One trial: plan, move, close, lift, hold; and the judgement.

Physics acts on the object from the first step to the last: it is never held, moved or reset by
anything but contacts and gravity.
"""

from __future__ import annotations

from collections.abc import Callable

import mujoco
import numpy as np

from dmfc.config.execution import ExecutionConfig
from dmfc.execution.outcome import Outcome
from dmfc.execution.trajectory import Trajectory, plan_trajectory
from dmfc.execution.watch import Watch
from dmfc.hand.approach import Approach
from dmfc.hand.model import HandModel
from dmfc.physics.measure import Depths, depths
from dmfc.physics.world import World

Observer = Callable[[str, World], None]
LOOK = 0.1
"""s between two looks at the state."""


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
        trajectory, outcome = self.plan(T_world_palm, joints, target)
        if outcome.planned:
            self._execute(trajectory, target, outcome, observer)
        return outcome

    # ── plan ─────────────────────────────────────────────────────────────────────────────────

    def plan(
        self, T_world_palm: np.ndarray, joints: np.ndarray, target: int
    ) -> tuple[Trajectory, Outcome]:
        """The motion of a grasp, and whether it is planned or why not; no physics is stepped."""
        trajectory = plan_trajectory(T_world_palm, joints, self.hand, self.config)
        outcome = Outcome()
        outcome.reason = self._check(trajectory, target, outcome)
        outcome.planned = not outcome.reason
        return trajectory, outcome

    def _check(self, trajectory: Trajectory, target: int, outcome: Outcome) -> str:
        """Reason why the motion does not fit, or the empty string.

        The open hand is checked from the pre-grasp to the grasp pose, then the closed hand there.
        """
        approach = Approach.of_execution(self.config)
        for stop in approach.stops(trajectory.T_grasp, trajectory.closed, self.hand):
            depth = self._depths(stop.T_palm, stop.joints, target, outcome)
            if depth.table > stop.table_tolerance:
                return "plan: table"
            if depth.target > stop.target_tolerance or depth.others > stop.tolerance:
                return "plan: object"
        return ""

    def _depths(
        self, T_world_palm: np.ndarray, joints: np.ndarray, target: int, outcome: Outcome
    ) -> Depths:
        """How deep the hand would be in everything around it at a pose."""
        world = self.world
        self._reset()
        world.place_palm(T_world_palm, joints)
        mujoco.mj_kinematics(world.model, world.data)
        mujoco.mj_collision(world.model, world.data)
        found = depths(world, target)
        outcome.plan_depth = max(outcome.plan_depth, found.table, found.target, found.others)
        return found

    def _reset(self) -> None:
        mujoco.mj_copyData(self.world.data, self.world.model, self._rest)

    # ── execute ──────────────────────────────────────────────────────────────────────────────

    def _execute(
        self, trajectory: Trajectory, target: int, outcome: Outcome, observer: Observer | None
    ) -> None:
        """Step through the phases until the end, or until the object is lost."""
        world, config = self.world, self.config
        self._reset()
        world.place_palm(trajectory.T_rest, trajectory.phases[0].joints_start)
        watch = Watch(world, target, self._rest_poses, config, outcome)
        look = max(1, round(LOOK / self.timestep))
        for phase in trajectory.phases:
            outcome.phase = phase.name
            if phase.name == "lift":
                watch.begin_lift(trajectory.T_lifted[2, 3] - trajectory.T_grasp[2, 3])
            commands = world.commands(*phase.commands(self.timestep))
            for first in range(0, len(commands), look):
                steps = commands[first : first + look]
                watch.keep(world.play(steps))
                outcome.seconds[phase.name] = (first + len(steps)) * self.timestep
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
