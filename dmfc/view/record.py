"""Records the poses of a trial, which a page can play."""

from __future__ import annotations

import numpy as np

from dmfc.execution.candidates import GraspCandidates
from dmfc.execution.protocol_test import ProtocolTest
from dmfc.hand.model import HandModel
from dmfc.physics.world import World
from dmfc.view.data import Motion, link_poses


class Recorder:
    """An observer of `ProtocolTest.run`."""

    def __init__(self, start: float) -> None:
        """`start`: the simulation's time when the trial begins, s."""
        self.start = start
        self.seconds: list[float] = []
        self.phase: list[str] = []
        self.palm: list[np.ndarray] = []
        self.joints: list[np.ndarray] = []
        self.objects: list[np.ndarray] = []

    def __call__(self, phase: str, world: World) -> None:
        self.seconds.append(world.data.time - self.start)
        self.phase.append(phase)
        self.palm.append(world.palm_pose())
        self.joints.append(world.joints())
        self.objects.append(np.stack([world.object_pose(k) for k in range(len(world.objects))]))


def record_trial(
    runner: ProtocolTest, hand: HandModel, candidates: GraspCandidates, trial: int, name: str
) -> Motion:
    """Run a trial and write it down. Without a frame where the grasp could not be planned.

    Links are posed by the palm and the degrees of freedom; coupled joints follow their driver.
    """
    recorder = Recorder(runner.world.data.time)
    outcome = runner.run(
        candidates.T[trial],
        candidates.joints[trial],
        int(candidates.object_index[trial]),
        recorder,
    )
    frames = len(recorder.seconds)
    T_world_palm = np.array(recorder.palm).reshape(frames, 4, 4)
    joints = np.array(recorder.joints).reshape(frames, hand.dofs)
    return Motion(
        name=name,
        outcome=outcome.reason or "held",
        seconds=np.array(recorder.seconds),
        phase=recorder.phase,
        T_world_link=link_poses(T_world_palm, joints, hand),
        T_world_object=np.array(recorder.objects).reshape(frames, len(runner.world.objects), 4, 4),
    )
