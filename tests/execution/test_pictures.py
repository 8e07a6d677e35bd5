"""Pictures of trials: the lines of the dense one against MuJoCo; strip, video and dense from GL."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import mujoco
import numpy as np
import pytest
from matplotlib.image import imread
from PIL import Image

from dmfc.config.execution import ExecutionConfig
from dmfc.config.physics import PhysicsConfig
from dmfc.execution.candidates import GraspCandidates, at_random
from dmfc.execution.selection import select
from dmfc.execution.trial import TrialRunner
from dmfc.hand.mjcf import PREFIX
from dmfc.hand.model import HandModel
from dmfc.physics.gl import probe
from dmfc.physics.world import World
from dmfc.visualization.dense import dense_picture, skeletons
from dmfc.visualization.trials import STEPS, trial_strip
from tests.support.execution_shapes import good, scene_of, standing
from tests.support.grasp_shapes import planned, shadow, shape
from tests.support.physics_shapes import AWAY


@pytest.fixture(scope="module")
def proposed(hand: HandModel) -> GraspCandidates:
    scene = scene_of(0, ["block"], [standing("block")], [])
    found = at_random(scene, hand, ExecutionConfig())
    found.confidence[:] = np.linspace(0, 1, len(found))
    return found


def test_skeletons_join_the_bodies_that_mujoco_places(
    hand: HandModel, proposed: GraspCandidates
) -> None:
    world = World(shadow()[1], [shape("block")], PhysicsConfig())
    lines = skeletons(proposed[np.arange(5)], hand)
    for row in range(5):
        world.reset()
        world.place_palm(proposed.T[row], proposed.joints[row])
        mujoco.mj_kinematics(world.model, world.data)
        joined = {
            (world.model.body(b).name, world.model.body(world.model.body_parentid[b]).name)
            for b in range(world.model.nbody)
        }
        place = {n: world.data.body(PREFIX + n).xpos for n in hand.link_names}
        bones = [
            (hand.link_names[p], n)
            for p, n in zip(hand.parents, hand.link_names, strict=True)
            if p >= 0
        ]
        assert {(PREFIX + child, PREFIX + parent) for parent, child in bones} <= joined
        expected = np.array([[place[parent], place[child]] for parent, child in bones])
        assert lines[row, : len(bones)] == pytest.approx(expected, abs=1e-6)
    # A line more for each fingertip, about as long as a Shadow Hand's last phalanx.
    tips = lines[:, len(bones) :]
    assert tips.shape[1] == 5
    lengths = np.linalg.norm(tips[:, :, 1] - tips[:, :, 0], axis=-1)
    assert (lengths > 0.02).all()
    assert (lengths < 0.04).all()


def test_the_dense_picture_has_the_colours_of_its_confidences(
    hand: HandModel, proposed: GraspCandidates, tmp_path: Path
) -> None:
    scene, path = scene_of(0, ["block"], [standing("block")], []), tmp_path / "sub" / "dense.png"
    executed = select(proposed, ExecutionConfig()).chosen
    dense_picture(scene.points, proposed, executed, hand, path, "scene 0")
    left, right = np.split(imread(path)[:, :1400, :3], 2, axis=1)
    for panel in (left, right):
        coloured = np.ptp(panel, axis=2) > 0.2
        assert coloured.mean() > 0.003
    assert (np.ptp(left, axis=2) > 0.1).mean() > 3 * (np.ptp(right, axis=2) > 0.1).mean()


def test_a_trial_is_filmed_as_it_was_run(hand: HandModel, tmp_path: Path) -> None:
    assert probe() == ""
    T, row, video = standing("block"), good("block")[0], tmp_path / "films" / "trial.gif"
    world = World(shadow()[1], [shape("block")], PhysicsConfig(), table_size=2.0, visual=True)
    trials = TrialRunner(world, hand, T[None], ExecutionConfig())
    T_world_palm = T @ planned("block").T_object_palm[row]
    chosen = GraspCandidates(
        T_world_palm[None, :3, 3],
        T_world_palm[None, :3, :3],
        planned("block").joints[row][None],
        np.ones(1),
        np.zeros(1, dtype=np.int64),
    )
    picture, outcome = trial_strip(trials, chosen, 0, size=96, video=video)
    assert outcome == trials.run(T_world_palm, chosen.joints[0], 0)
    assert outcome.held
    assert picture.size == (96 * (len(STEPS) + 1), 96)
    steps = np.split(np.asarray(picture, dtype=float)[20:], len(STEPS) + 1, axis=1)
    for before, after in pairwise(steps):
        assert np.abs(after - before).mean() > 0.5
    with Image.open(video) as film:
        assert film.info["duration"] == 100
        # Frames that are equal may have been joined; of 4.8 s no more than 48 are there.
        assert 20 < film.n_frames <= 48


def test_what_is_drawn_is_where_it_is(hand: HandModel) -> None:
    """The block is orange; it is seen above the table where it is put above the table."""
    from dmfc.visualization.simulation import Camera

    world = World(shadow()[1], [shape("block")], PhysicsConfig(), table_size=2.0, visual=True)
    rows = []
    with Camera(world, 120, 120) as camera:
        for height in (0.06, 0.26):
            world.reset()
            world.place_palm(AWAY, world.hand.open_joints)
            T = standing("block")
            T[2, 3] = height
            world.place_object(0, T)
            mujoco.mj_forward(world.model, world.data)
            frame = camera.frame().astype(int)
            orange = frame[..., 0] - frame[..., 2] > 80
            assert orange.sum() > 50
            rows.append(np.argwhere(orange)[:, 0].mean())
    assert rows[0] - rows[1] > 20  # rows count from above
