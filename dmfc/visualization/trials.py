"""Pictures of trials: the steps of the execution side by side, and moving pictures."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np
from PIL import Image

from dmfc.execution.candidates import GraspCandidates
from dmfc.execution.outcome import Outcome
from dmfc.execution.protocol_test import ProtocolTest
from dmfc.execution.trial import LOOK
from dmfc.physics.world import World
from dmfc.visualization.simulation import Camera, strip

Moments = dict[tuple[str, int], str]
"""(phase, number of the look in it) -> what a frame taken then is called."""
STEPS: Moments = {("approach", 1): "pre-grasp", ("close", 1): "grasp", ("lift", 1): "closed"}
"""With the end, the four steps of the paper's Figure 4."""
DETAILED: Moments = {
    (phase, look): phase
    for phase, look in (
        ("raise", 3),
        ("descend", 4),
        ("approach", 4),
        ("close", 3),
        ("squeeze", 2),
        ("lift", 5),
        ("lift", 10),
        ("hold", 19),
    )
}
"""More of them, to see why a trial failed."""


def trial_strip(
    runner: ProtocolTest,
    candidates: GraspCandidates,
    trial: int,
    *,
    size: int = 300,
    moments: Moments = STEPS,
    video: Path | None = None,
) -> tuple[Image.Image, Outcome]:
    """Run a trial and picture it: a row of frames, `size` pixels each, the last one its end.

    With `video`, every look goes into that GIF, in real time. `runner` must have been opened with
    `visual=True`; needs GL.
    """
    world = runner.world
    T = candidates.T[trial]
    target = int(candidates.object_index[trial])
    frames: list[np.ndarray] = []
    labels: list[str] = []
    film: list[Image.Image] = []
    looks: Counter[str] = Counter()
    with _camera(world, T, target, size) as camera:

        def watch(phase: str, world: World) -> None:
            looks[phase] += 1
            label = moments.get((phase, looks[phase]))
            if label or video:
                frame = camera.frame()
                if label:
                    frames.append(frame)
                    labels.append(label)
                if video:
                    film.append(Image.fromarray(frame))

        outcome = runner.run(T, candidates.joints[trial], target, watch)
        frames.append(camera.frame())
        labels.append(outcome.reason or "held")
    if video and film:
        video.parent.mkdir(parents=True, exist_ok=True)
        film[0].save(
            video, save_all=True, append_images=film[1:], duration=round(1000 * LOOK), loop=0
        )
    return strip(frames, labels), outcome


def _camera(world: World, T_world_palm: np.ndarray, target: int, size: int) -> Camera:
    """From the side, so that neither the hand nor the object hides the other."""
    centre = world.object_pose(target)[:3, 3]
    beside = T_world_palm[:3, 3] - centre
    azimuth = float(np.degrees(np.arctan2(beside[1], beside[0]))) + 100.0
    look_at = (float(centre[0]), float(centre[1]), 0.17)
    return Camera(world, size, size, look_at=look_at, distance=0.85, azimuth=azimuth)
