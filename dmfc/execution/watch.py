"""Watches the object and the physics during a trial, and judges it."""

from __future__ import annotations

import math

import numpy as np
import torch

from dmfc.config.execution import ExecutionConfig
from dmfc.config.losses import Q1Config
from dmfc.execution.outcome import Outcome
from dmfc.losses.q1 import q1_of_contacts
from dmfc.physics.measure import (
    Depths,
    Touch,
    depths,
    kinetic_speed,
    saturated,
    supported,
    touch,
)
from dmfc.physics.world import Peaks, World

LIFTED = 0.01
"""m that the object's centre must have risen to have been lifted."""


class Watch:
    """Writes what it sees of object `target` into the outcome; sets its reason when it is lost."""

    def __init__(
        self,
        world: World,
        target: int,
        rest_poses: list[np.ndarray],
        config: ExecutionConfig,
        outcome: Outcome,
    ) -> None:
        """`rest_poses`: T_world_object [4, 4] of every object before the hand moved."""
        self.world, self.target, self.config, self.outcome = world, target, config, outcome
        self.rest_poses = rest_poses
        self.centre = np.append(world.objects[target].com, 1.0)
        self.rise = 0.0
        self.lifted = False
        """Whether the hand has had the object in the air: tipped up on an edge it is not."""
        self.last_touch = 0.0
        self.closing_looks = 0
        self.rest_height = float((rest_poses[target] @ self.centre)[2])
        self._find()
        self.in_palm: dict[str, tuple[np.ndarray, np.ndarray]] = {}
        """Where the object was in the hand when the lift and the hold began."""

    def keep(self, peaks: Peaks) -> None:
        """The peaks that came and went since the last look."""
        outcome = self.outcome
        outcome.contact_penetration = max(outcome.contact_penetration, peaks.penetration)
        outcome.contact_force = max(outcome.contact_force, peaks.force)

    def look(self, phase: str) -> None:
        """Every 0.1 s: the physical checks, then whether the object is still there."""
        if self._diverged():
            self.outcome.reason = "diverged"
            return
        self._find()
        deep = depths(self.world, self.target)
        self._measure(phase, deep)
        if deep.target > 0:
            self.last_touch = self.world.data.time
        if not self.in_palm:
            self._pushed()
            return
        self._follow(phase)
        if not self.lifted and deep.target > 0 and self._height() > LIFTED:
            self.lifted = not supported(self.world, self.target)
        if self.world.data.time - self.last_touch > self.config.lost_time:
            self.outcome.reason = self._lost(phase)

    def _find(self) -> None:
        """Where the object is."""
        self.T_world_object = self.world.object_pose(self.target)
        self.position = (self.T_world_object @ self.centre)[:3]

    def begin_lift(self, rise: float) -> None:
        """Before the lift of `rise` metres: how is the object held?"""
        self.rise = rise
        found = touch(self.world, self.target)
        self.outcome.contacts = found.links
        self.outcome.q1 = self._q1(found)
        self.last_touch = self.world.data.time
        self.in_palm["lift"] = self._in_palm()

    def end_lift(self) -> None:
        """After the lift the object must have come along."""
        self.in_palm["hold"] = self._in_palm()
        if self._height() < self.config.lift_fraction * self.rise:
            self.outcome.reason = self._lost("lift")

    def end(self) -> None:
        """After the hold: in the hand, near the palm, off the table and off its neighbours."""
        config, outcome = self.config, self.outcome
        palm = self.world.palm_pose()[:3, 3]
        near = np.linalg.norm(self.position - palm) <= config.palm_distance
        high = self._height() >= config.lift_fraction * self.rise
        slip, turn = self._motion("lift")
        steady = (not config.max_slip or slip <= config.max_slip) and (
            not config.max_turn or turn <= config.max_turn
        )
        touching = depths(self.world, self.target).target > 0
        resting = supported(self.world, self.target)
        outcome.held = bool(touching and near and high and steady and not resting)
        outcome.reason = "" if outcome.held else "dropped in hold"

    def _diverged(self) -> bool:
        """Whether the state broke, or an object moves as nothing in the scene could make it."""
        if self.world.diverged():
            return True
        speeds = [kinetic_speed(self.world, k) for k in range(len(self.rest_poses))]
        self.outcome.kinetic_speed = max(self.outcome.kinetic_speed, *speeds)
        return self.outcome.kinetic_speed > self.config.blow_up_speed

    def _measure(self, phase: str, deep: Depths) -> None:
        world, outcome = self.world, self.outcome
        outcome.hand_penetration = max(outcome.hand_penetration, deep.target, deep.others)
        outcome.self_penetration = max(outcome.self_penetration, deep.itself)
        for k, rest in enumerate(self.rest_poses):
            if k != self.target:
                moved = (world.object_pose(k) - rest) @ np.append(world.objects[k].com, 1.0)
                distance = float(np.linalg.norm(moved[:3]))
                outcome.neighbour_moved = max(outcome.neighbour_moved, distance)
        if phase in ("raise", "descend"):
            outcome.touched_early |= max(deep.table, deep.target, deep.others) > 0
        elif phase != "approach":
            self.closing_looks += 1
            outcome.saturation += (saturated(world) - outcome.saturation) / self.closing_looks

    def _pushed(self) -> None:
        moved = self.T_world_object - self.rest_poses[self.target]
        self.outcome.pushed = math.hypot(*(moved @ self.centre)[:3])
        if self.outcome.pushed > self.config.knock_distance:
            self.outcome.reason = "knocked away"

    def _q1(self, found: Touch) -> float:
        """Of the contacts, by the metric's own constants, torques about the centre of mass."""
        if not len(found):
            return 0.0
        arms = torch.from_numpy(found.position - self.position)[None]
        normals = torch.from_numpy(found.outward)[None]
        distance = torch.zeros(1, len(found), dtype=arms.dtype)
        return float(q1_of_contacts(arms, normals, distance, Q1Config()))

    def _lost(self, phase: str) -> str:
        if phase == "hold":
            return "dropped in hold"
        return "dropped in lift" if self.lifted else "no lift"

    def _follow(self, phase: str) -> None:
        slip, turn = self._motion(phase)
        outcome = self.outcome
        if phase == "lift":
            outcome.lift_slip = max(outcome.lift_slip, slip)
            outcome.lift_turn = max(outcome.lift_turn, turn)
        else:
            outcome.hold_slip = max(outcome.hold_slip, slip)
            outcome.hold_turn = max(outcome.hold_turn, turn)

    def _motion(self, since: str) -> tuple[float, float]:
        """How far the object has moved and turned in the hand since a phase began."""
        (start, R_start), (now, R_now) = self.in_palm[since], self._in_palm()
        # trace(A^T B) is the sum of the products of their entries.
        cosine = (np.vdot(R_start, R_now) - 1) / 2
        return math.dist(start, now), math.acos(min(1.0, max(-1.0, cosine)))

    def _in_palm(self) -> tuple[np.ndarray, np.ndarray]:
        """The object's centre in the palm's frame [3], and R_palm_object [3, 3]."""
        T = self.world.palm_pose()
        R_palm_world = T[:3, :3].T
        centre = R_palm_world @ (self.position - T[:3, 3])
        return centre, R_palm_world @ self.T_world_object[:3, :3]

    def _height(self) -> float:
        """How far the object's centre is above where it rested, metres."""
        return float(self.position[2]) - self.rest_height
