"""The six-direction test of DexGraspBench: does the hand hold an object that is pulled anywhere?

Object and hand float; there is no table and no gravity. From the opened hand the fingers close to
the grasp and on to the squeeze. Then a force of 10 m/s^2 times the object's mass acts on its centre
for `execution.hold_time`, along one axis of the world: six times, each from the beginning. A grasp
is held if the object never moved by `execution.max_slip` or turned by `execution.max_turn`. It is
not tried where the hand at the grasp is deeper in the object than `execution.grasp_tolerance`.
"""

from __future__ import annotations

import math

import mujoco
import numpy as np

from dmfc.execution.outcome import Outcome
from dmfc.execution.protocol_test import Setup
from dmfc.execution.trial import Observer
from dmfc.physics.measure import depths, touch
from dmfc.physics.world import pose_to_qpos

ACCELERATION = 10.0
"""m/s^2: the force per mass."""
LOOK = 0.2
"""s between two looks at the object."""
COMMANDS = 10
"""Commands on the way of the fingers, each held for the same time."""
DIRECTIONS = np.array([[-1, 0, 0], [1, 0, 0], [0, -1, 0], [0, 1, 0], [0, 0, -1], [0, 0, 1]])


class SixDirections:
    """See `dmfc.execution.protocol_test.ProtocolTest`. Other objects of a scene are far away."""

    def __init__(self, setup: Setup) -> None:
        self.setup, self.config = setup, setup.config
        self.world = setup.world(table=False)

    def run(
        self,
        T_world_palm: np.ndarray,
        joints: np.ndarray,
        target: int,
        observer: Observer | None = None,
    ) -> Outcome:
        """Execute a grasp [4, 4], [D] rad on object `target`."""
        hand = self.setup.hand
        joints = np.clip(joints, hand.lower, hand.upper)
        outcome = Outcome(reason="")
        self._start(T_world_palm, joints, target)
        outcome.plan_depth = max(depths(self.world, target).target, 0.0)
        if outcome.plan_depth > self.config.grasp_tolerance:
            outcome.reason = "plan: object"
            return outcome
        outcome.planned = True
        for direction in DIRECTIONS:
            self._push(T_world_palm, joints, target, direction, outcome, observer)
            if outcome.reason:
                return outcome
        outcome.held = True
        return outcome

    def _push(
        self,
        T_world_palm: np.ndarray,
        joints: np.ndarray,
        target: int,
        direction: np.ndarray,
        outcome: Outcome,
        observer: Observer | None,
    ) -> None:
        """Close and squeeze, then pull the object in one direction."""
        hand, config, world = self.setup.hand, self.config, self.world
        opened, squeezed = hand.opened(joints), hand.squeezed(joints)
        self._start(T_world_palm, opened, target)
        start = world.object_pose(target)
        legs = [("close", config.close_time, opened, joints)]
        legs.append(("squeeze", config.squeeze_time, joints, squeezed))
        for name, seconds, begin, end in legs:
            outcome.phase = name
            for share in np.arange(1, COMMANDS + 1) / COMMANDS:
                commanded = begin + share * (end - begin)
                self._play(T_world_palm, commanded, seconds / COMMANDS, outcome)
            if observer:
                observer(name, world)
        outcome.contacts = touch(world, target).links
        world.model.opt.gravity[:] = ACCELERATION * direction
        outcome.phase = "hold"
        for _ in range(max(1, round(config.hold_time / LOOK))):
            self._play(T_world_palm, squeezed, LOOK, outcome)
            if observer:
                observer("hold", world)
            if self._lost(start, target, outcome):
                return

    def _lost(self, start: np.ndarray, target: int, outcome: Outcome) -> bool:
        """Whether the simulation broke, or the object is no longer where it was."""
        if self.world.diverged():
            outcome.reason = "diverged"
            return True
        centre = np.append(self.world.objects[target].com, 1.0)
        now = self.world.object_pose(target)
        moved = float(np.linalg.norm(((now - start) @ centre)[:3]))
        cosine = (np.vdot(start[:3, :3], now[:3, :3]) - 1) / 2
        turned = math.acos(min(1.0, max(-1.0, cosine)))
        outcome.hold_slip = max(outcome.hold_slip, moved)
        outcome.hold_turn = max(outcome.hold_turn, turned)
        if moved >= self.config.max_slip or turned >= self.config.max_turn:
            outcome.reason = "dropped in hold"
        return bool(outcome.reason)

    def _play(
        self, T_world_palm: np.ndarray, joints: np.ndarray, seconds: float, outcome: Outcome
    ) -> None:
        """Hold a command for some time."""
        steps = max(1, round(seconds / self.world.model.opt.timestep))
        pose = np.tile(pose_to_qpos(T_world_palm), (steps, 1))
        peaks = self.world.play(self.world.commands(pose, np.tile(joints, (steps, 1))))
        outcome.contact_penetration = max(outcome.contact_penetration, peaks.penetration)
        outcome.contact_force = max(outcome.contact_force, peaks.force)
        spent = outcome.seconds.get(outcome.phase, 0.0)
        outcome.seconds[outcome.phase] = spent + steps * self.world.model.opt.timestep

    def _start(self, T_world_palm: np.ndarray, joints: np.ndarray, target: int) -> None:
        """The object where it rests, the hand at the grasp with these joints, nothing moving."""
        world = self.world
        world.reset()
        world.model.opt.gravity[:] = 0.0
        # The others wait ten metres below, without weight.
        world.model.body_gravcomp[world.index.object_body] = 1.0
        world.model.body_gravcomp[world.index.object_body[target]] = 0.0
        world.place_object(target, self.setup.T_world_object[target])
        world.place_palm(T_world_palm, joints)
        mujoco.mj_forward(world.model, world.data)
