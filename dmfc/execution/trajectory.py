"""Where the palm and the fingers are to be at any time of a trial: named phases."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dmfc.config.execution import ExecutionConfig
from dmfc.hand.approach import Approach
from dmfc.hand.model import HandModel
from dmfc.physics.world import pose_to_qpos


@dataclass(frozen=True)
class Phase:
    """A straight, smooth motion of palm and fingers; the palm never turns."""

    name: str
    seconds: float
    T_start: np.ndarray
    """[4, 4] T_world_palm."""
    T_end: np.ndarray
    joints_start: np.ndarray
    """[D] commanded angles, rad."""
    joints_end: np.ndarray

    def commands(self, timestep: float) -> tuple[np.ndarray, np.ndarray]:
        """Palm poses [n, 7] (x y z qw qx qy qz) and joints [n, D] of every step.

        Minimum-jerk in time: 10 s^3 - 15 s^4 + 6 s^5.
        """
        steps = max(1, round(self.seconds / timestep))
        s = np.arange(1, steps + 1) / steps
        s = s**3 * (10 - 15 * s + 6 * s**2)
        start = pose_to_qpos(self.T_start)
        poses = np.tile(start, (steps, 1))
        poses[:, :3] += s[:, None] * (self.T_end[:3, 3] - start[:3])
        joints = self.joints_start + s[:, None] * (self.joints_end - self.joints_start)
        return poses, joints


@dataclass(frozen=True)
class Trajectory:
    """The poses that a trial passes through, and the phases between them."""

    T_rest: np.ndarray
    T_raised: np.ndarray
    T_pregrasp: np.ndarray
    T_grasp: np.ndarray
    T_lifted: np.ndarray
    opened: np.ndarray
    """[D] rad, before the fingers close."""
    closed: np.ndarray
    """[D] rad, the grasp."""
    phases: list[Phase]


def plan_trajectory(
    T_grasp: np.ndarray,
    joints: np.ndarray,
    hand: HandModel,
    config: ExecutionConfig,
) -> Trajectory:
    """Resting pose, above the pre-grasp, pre-grasp, grasp, close, squeeze, lift, hold.

    The hand rests with its own open posture and takes that of the grasp while it is raised: some
    grasps are opened to where fingers overlap, and a simulation that began there would burst apart.
    With `execution.start` 'pregrasp' the motion begins there all the same.
    T_grasp: T_world_palm [4, 4]; joints: [D] rad, clamped to the limits.
    """
    joints = np.clip(joints, hand.lower, hand.upper)
    T_pregrasp = Approach.of_execution(config).pregrasp(T_grasp, hand)
    rise = max(config.min_rise, config.rest_height - T_grasp[2, 3])
    T_lifted = _moved(T_grasp, np.array([0.0, 0.0, rise]))
    T_raised = T_pregrasp.copy()
    T_raised[2, 3] = max(config.rest_height, T_pregrasp[2, 3])
    T_rest = T_raised.copy()
    T_rest[:2, 3] = 0.0
    opened, squeezed = hand.opened(joints), hand.squeezed(joints)
    legs = [
        ("raise", config.raise_time, T_raised, opened),
        ("descend", config.descend_time, T_pregrasp, opened),
        ("approach", config.approach_time, T_grasp, opened),
        ("close", config.close_time, T_grasp, squeezed),
        ("squeeze", config.squeeze_time, T_grasp, squeezed),
        ("lift", config.lift_time, T_lifted, squeezed),
        ("hold", config.hold_time, T_lifted, squeezed),
    ]
    if config.start == "pregrasp":
        T_rest, legs = T_pregrasp, legs[2:]
    phases = []
    T, angles = T_rest, opened if config.start == "pregrasp" else hand.open_joints
    for name, seconds, T_end, angles_end in legs:
        phases.append(Phase(name, seconds, T, T_end, angles, angles_end))
        T, angles = T_end, angles_end
    return Trajectory(T_rest, T_raised, T_pregrasp, T_grasp, T_lifted, opened, joints, phases)


def _moved(T: np.ndarray, shift: np.ndarray) -> np.ndarray:
    moved = T.copy()
    moved[:3, 3] += shift
    return moved
