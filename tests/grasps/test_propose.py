"""Candidates: free before they close, in touch after, above the table, the same for one seed."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import torch

from dmfc.config.grasps import GraspsConfig
from dmfc.grasps.propose import Candidates, Proposer
from dmfc.hand.description import HandDescription
from dmfc.hand.fingers import fingers
from dmfc.hand.kinematics import HandKinematics
from dmfc.hand.model import HandModel
from tests.support.grasp_shapes import BALL_RADIUS, BLOCK_SIZE, CONFIG, depth_in_block, shape
from tests.support.scene_shapes import paddle

BOTTOM = -BLOCK_SIZE[2] / 2


@pytest.fixture(scope="module")
def proposer(hand: HandModel, description: HandDescription) -> Proposer:
    return Proposer(shape("block"), hand, description, CONFIG)


@pytest.fixture(scope="module")
def drawn(proposer: Proposer) -> Candidates:
    return proposer.draw(120, np.random.default_rng(0))


def surface(hand: HandModel, candidates: Candidates, joints: np.ndarray) -> np.ndarray:
    """[B, 2000, 3] every collision point of the hand, object frame."""
    T = np.tile(np.eye(4), (len(candidates), 1, 1))
    T[:, :3, :3], T[:, :3, 3] = candidates.rotation, candidates.position
    kinematics = HandKinematics(hand)
    return kinematics.collision_points(torch.as_tensor(T), torch.as_tensor(joints)).numpy()


def test_there_are_candidates_and_their_arrays_agree(hand: HandModel, drawn: Candidates) -> None:
    count = len(drawn)
    assert 15 < count < 120
    assert drawn.rotation.shape == (count, 3, 3)
    assert drawn.preshape.shape == drawn.joints.shape == (count, 18)
    assert drawn.touching.shape == (count, 5)
    assert drawn.stable_pose.shape == (count,)
    turned = np.einsum("bij,bkj->bik", drawn.rotation, drawn.rotation)
    assert turned == pytest.approx(np.tile(np.eye(3), (count, 1, 1)), abs=1e-12)
    assert np.linalg.det(drawn.rotation) == pytest.approx(1.0)
    for joints in (drawn.preshape, drawn.joints):
        assert (joints >= hand.lower).all()
        assert (joints <= hand.upper).all()


def test_the_open_hand_is_free_of_the_object(hand: HandModel, drawn: Candidates) -> None:
    depth = depth_in_block(surface(hand, drawn, drawn.preshape))
    assert depth.max() < 0.0


def test_fingers_that_close_touch_and_the_others_stay_open(
    hand: HandModel, proposer: Proposer, drawn: Candidates
) -> None:
    depth = depth_in_block(surface(hand, drawn, drawn.joints))
    finger = proposer.finger_of_link[hand.collision_link]
    assert (drawn.touching.sum(axis=1) >= 2).all()
    for f in range(5):
        deepest = depth[:, finger == f].max(axis=1)
        touching = drawn.touching[:, f]
        assert np.abs(deepest[touching]).max() < 0.003
        assert np.median(np.abs(deepest[touching])) < 0.001
        assert (deepest[~touching] < 0.0).all()
        own = proposer.finger_of_dof == f
        assert np.array_equal(drawn.joints[~touching][:, own], drawn.preshape[~touching][:, own])
    moved = (drawn.joints - drawn.preshape) * np.sign(hand.flexion)
    assert (moved >= -1e-12).all()
    rigid = hand.flexion == 0
    assert np.array_equal(drawn.joints[:, rigid], drawn.preshape[:, rigid])


def test_the_palm_looks_at_the_object(hand: HandModel, drawn: Candidates) -> None:
    reference = drawn.position + drawn.rotation @ hand.palm_reference
    towards = -reference / np.linalg.norm(reference, axis=1, keepdims=True)
    assert (np.einsum("bi,bi->b", towards, drawn.rotation @ hand.palm_normal) > 0).mean() > 0.9


def test_candidates_for_a_table_keep_above_it(hand: HandModel, drawn: Candidates) -> None:
    """The block has one stable pose, as it stands: the table is the plane z = BOTTOM."""
    assert (drawn.stable_pose == 0).all()
    for joints in (drawn.preshape, drawn.joints, hand.opened(drawn.joints)):
        assert surface(hand, drawn, joints)[..., 2].min() > BOTTOM


def test_candidates_without_a_table_reach_below(
    hand: HandModel, description: HandDescription
) -> None:
    config = dataclasses.replace(CONFIG, table_share=0.0)
    drawn = Proposer(shape("block"), hand, description, config).draw(100, np.random.default_rng(0))
    assert (drawn.stable_pose == -1).all()
    assert (surface(hand, drawn, drawn.joints)[..., 2].min(axis=1) < BOTTOM).mean() > 0.2


def test_the_same_seed_draws_the_same(proposer: Proposer, drawn: Candidates) -> None:
    again = proposer.draw(120, np.random.default_rng(0))
    other = proposer.draw(120, np.random.default_rng(1))
    for entry in dataclasses.fields(Candidates):
        assert np.array_equal(getattr(drawn, entry.name), getattr(again, entry.name))
    assert not np.array_equal(drawn.position[:3], other.position[:3])


def test_a_hand_that_fits_nowhere_gives_no_candidates(
    hand: HandModel, description: HandDescription
) -> None:
    deep = GraspsConfig(palm_gap=[-0.03, -0.03], palm_shift=[0.0, 0.0], back_off=0.0)
    drawn = Proposer(shape("block"), hand, description, deep).draw(50, np.random.default_rng(0))
    assert len(drawn) == 0
    assert drawn.joints.shape == (0, 18)
    assert drawn.touching.shape == (0, 5)
    assert drawn.stable_pose.shape == (0,)


def test_the_hand_is_centred_on_the_width_that_it_straddles(
    hand: HandModel, description: HandDescription
) -> None:
    """Aimed e beside the centre of a ball, the middle of its width is -e.r along each roll r."""
    config = dataclasses.replace(CONFIG, rolls=1, straddle_share=1.0)
    proposer = Proposer(shape("ball"), hand, description, config)
    aside = np.zeros((40, 3))
    aside[:, 1] = np.linspace(-0.015, 0.015, 40)
    target = np.array([BALL_RADIUS, 0.0, 0.0]) + aside
    approach = np.tile([-1.0, 0.0, 0.0], (40, 1))
    rolls, middle = proposer._straddle(target, approach, np.random.default_rng(0))
    assert middle[:, 0] == pytest.approx(-np.einsum("bi,bi->b", aside, rolls), abs=0.005)
    falls = dataclasses.replace(config, straddle_share=0.0)
    left = Proposer(shape("ball"), hand, description, falls)
    assert not left._straddle(target, approach, np.random.default_rng(0))[1].any()


def test_fingers_are_what_hangs_on_the_palm(hand: HandModel) -> None:
    of_dof, of_link = fingers(hand)
    links = {
        f: {name for name, own in zip(hand.link_names, of_link, strict=True) if own == f}
        for f in range(-1, 5)
    }
    assert links[-1] == {"rh_palm"}
    named = {frozenset(name[3:5] for name in links[f]) for f in range(5)}
    assert named == {frozenset([letter]) for letter in ("ff", "mf", "rf", "lf", "th")}
    dofs = {name: int(f) for name, f in zip(hand.dof_names, of_dof, strict=True)}
    assert len(set(dofs.values())) == 5
    assert {name for name, f in dofs.items() if f == dofs["rh_LFJ5"]} == {
        *("rh_LFJ5", "rh_LFJ4", "rh_LFJ3", "rh_LFJ2")
    }
    assert sum(f == dofs["rh_THJ1"] for f in dofs.values()) == 5


def test_a_paddle_has_one_finger() -> None:
    of_dof, of_link = fingers(paddle())
    assert of_dof.tolist() == [0]
    assert of_link.tolist() == [-1, 0]
