"""Pictures of trials: the steps of the execution side by side."""

from __future__ import annotations

from collections import Counter

import numpy as np
from PIL import Image

from dmfc.execution.candidates import GraspCandidates
from dmfc.execution.trial import Outcome, TrialRunner
from dmfc.physics.picture import Camera, strip
from dmfc.physics.world import World

FRAMES = (
    ("raise", 6),
    ("descend", 8),
    ("approach", 8),
    ("close", 5),
    ("squeeze", 4),
    ("lift", 10),
    ("lift", 20),
    ("hold", 38),
)
"""Looks at which a frame is taken: phase, and the number of the look in it (every 50 ms)."""


def trial_strip(
    runner: TrialRunner, candidates: GraspCandidates, trial: int, size: int = 300
) -> tuple[Image.Image, Outcome]:
    """Run a trial and picture it: a row of frames, `size` pixels each, the last one its end.

    `runner` must have been opened with `visual=True`; needs GL.
    """
    world = runner.world
    T = candidates.T_world_palm(trial)
    target = int(candidates.object_index[trial])
    centre = world.object_pose(target)[:3, 3]
    beside = T[:3, 3] - centre
    # From the side, so that neither the hand nor the object hides the other.
    azimuth = float(np.degrees(np.arctan2(beside[1], beside[0]))) + 100.0
    look_at = (float(centre[0]), float(centre[1]), 0.17)
    frames: list[np.ndarray] = []
    labels: list[str] = []
    looks: Counter[str] = Counter()
    with Camera(world, size, size, look_at=look_at, distance=0.85, azimuth=azimuth) as camera:

        def watch(phase: str, world: World) -> None:
            looks[phase] += 1
            if (phase, looks[phase]) in FRAMES:
                frames.append(camera.frame())
                labels.append(phase)

        outcome = runner.run(T, candidates.joints[trial], target, watch)
        frames.append(camera.frame())
        labels.append(outcome.reason or "held")
    return strip(frames, labels), outcome
