"""Power and precision: which links touch, against closed forms and the hand's own frames."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from dmfc.grasps.grasp_set import GraspSet
from dmfc.grasps.grip import GRIPS, TOUCH, grip_row, grips, link_distances, link_ranks
from dmfc.hand.kinematics import HandKinematics
from dmfc.hand.model import HandModel
from tests.support.grasp_shapes import BALL_RADIUS, depth_in_block, planned, shape


def around_ball(hand: HandModel, centre: np.ndarray) -> GraspSet:
    """The open hand with the ball's centre at `centre` [3] of the palm frame."""
    one, vector = np.ones(1), np.full((1, 3), np.nan)
    joints = hand.open_joints[None]
    turn = np.eye(3)[None]
    return GraspSet(
        -centre[None], turn, joints, "ball", hand.name, hand.dof_names, vector, one, one, one, one
    )


def beside(hand: HandModel, name: str, gap: float) -> np.ndarray:
    """Centre of a ball, `gap` metres off the inside of a link of the open hand, palm frame."""
    link = next(i for i, known in enumerate(hand.link_names) if known.endswith(name))
    T = torch.eye(4, dtype=torch.float64)[None]
    points, normals = HandKinematics(hand).inner_points(T, torch.as_tensor(hand.open_joints)[None])
    own = np.flatnonzero(hand.inner_link == link)
    row = own[len(own) // 2]
    return (points[0, row] + (BALL_RADIUS + gap) * normals[0, row]).numpy()


def test_links_are_ranked_by_their_place_on_the_finger(hand: HandModel) -> None:
    ranks = dict(zip((name[3:] for name in hand.link_names), link_ranks(hand), strict=True))
    for finger in ("ff", "mf", "rf", "lf", "th"):
        assert (ranks[f"{finger}distal"], ranks[f"{finger}middle"]) == (1, 2)
        assert ranks[f"{finger}proximal"] == 3
    assert ranks["palm"] == ranks["lfmetacarpal"] == ranks["thbase"] == 3


@pytest.mark.parametrize(
    ("link", "gap", "expected"),
    [
        ("palm", 0.0, "power"),
        ("ffproximal", 0.0, "power"),
        ("thdistal", 0.0, "precision"),
        ("palm", 0.3, "none"),
    ],
)
def test_a_ball_beside_one_link(hand: HandModel, link: str, gap: float, expected: str) -> None:
    found = grips(around_ball(hand, beside(hand, link, gap)), hand, shape("ball"))
    assert [GRIPS[number] for number in found] == [expected]


def test_distances_of_links_are_those_of_the_block(hand: HandModel) -> None:
    grasps = planned("block")
    distance = link_distances(grasps, hand, shape("block"))
    for row in range(len(grasps)):
        T = torch.as_tensor(grasps.T_object_palm[row : row + 1])
        joints = torch.as_tensor(grasps.joints[row : row + 1])
        points = HandKinematics(hand).collision_points(T, joints)[0].numpy()
        exact = depth_in_block(points)
        for link in range(hand.links):
            deepest = exact[hand.collision_link == link].max()
            if deepest > -0.01:  # the grid ends 2 cm off
                assert distance[row, link] == pytest.approx(deepest, abs=0.001)
    touching = distance >= -TOUCH
    names = np.array([name[3:] for name in hand.link_names])
    for row, number in enumerate(grips(grasps, hand, shape("block"))):
        tips_alone = all(name.endswith("distal") for name in names[touching[row]])
        assert (GRIPS[number] == "precision") == (tips_alone and touching[row].any())


def test_shares_are_of_all_grasps() -> None:
    numbers = np.array([GRIPS.index(n) for n in ("power", "power", "precision", "none")])
    assert grip_row(numbers) == {"power": 0.5, "precision": 0.25}
    assert grip_row(numbers[:0]) == {"power": None, "precision": None}
