"""The scene terms of whole grasps, the clamp, and the weighted sum."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from dmfc.config.losses import LengthUnits, LossConfig, LossWeights, Q1Config
from dmfc.errors import DmfcError
from dmfc.geometry.rotations import matrix_from_6d, sixd_from_matrix
from dmfc.hand.model import HandModel
from dmfc.losses.task import SceneTerms, active_terms, weighted_sum
from dmfc.objects.atlas import SceneObjects
from tests.support.loss_shapes import slope
from tests.support.rotations import random_rotations

ALL = ("collision", "guidance", "q1_upper", "q1_lower", "swept")


def grasps(hand: HandModel, dtype: torch.dtype = torch.float64):
    generator = torch.Generator().manual_seed(0)
    rotation = random_rotations(2, generator, torch.float64)
    # The middle of the hand, 8 cm along its fingers and 4 cm off its palm, is at the ball.
    centre = torch.tensor([[0.0, 0.0, 0.1], [0.02, 0.01, 0.1]], dtype=torch.float64)
    position = centre - rotation @ torch.tensor([0, -0.04, 0.08], dtype=torch.float64)
    joints = torch.tensor(np.clip(hand.open_joints + 0.4 * hand.flexion, hand.lower, hand.upper))
    joints = joints.expand(2, -1) + 0.01 * torch.randn(2, 18, generator=generator).double()
    return tuple(x.to(dtype) for x in (position, rotation, joints))


@pytest.mark.parametrize("name", ALL)
def test_gradient_of_a_whole_grasp(hand: HandModel, scene: SceneObjects, name: str) -> None:
    terms = SceneTerms(hand, LossConfig(q1=Q1Config(torque_weight=10.0)))
    position, rotation, joints = grasps(hand)

    def loss(p: torch.Tensor, sixd: torch.Tensor, q: torch.Tensor) -> torch.Tensor:
        return terms(p, matrix_from_6d(sixd[:, :3], sixd[:, 3:]), q, scene, [name])[name]

    analytic, differences = slope(loss, position, sixd_from_matrix(rotation), joints)
    assert analytic == pytest.approx(differences, rel=1e-3)
    assert analytic != 0


def test_terms_that_are_not_wanted_are_not_computed(hand: HandModel, scene: SceneObjects) -> None:
    terms = SceneTerms(hand, LossConfig())
    assert set(terms(*grasps(hand), scene, ["guidance"])) == {"guidance"}
    every = terms(*grasps(hand), scene, ALL)
    assert set(every) == set(ALL)
    assert all(value.shape == (2,) and (value > 0).all() for value in every.values())
    assert torch.equal(every["guidance"], terms(*grasps(hand), scene, ["guidance"])["guidance"])


def test_float32_agrees(hand: HandModel, scene: SceneObjects) -> None:
    terms = SceneTerms(hand, LossConfig())
    single = terms(*grasps(hand, torch.float32), scene, ALL)
    double = terms(*grasps(hand), scene, ALL)
    for name in ALL:
        assert single[name].dtype == torch.float32
        assert single[name].numpy() == pytest.approx(double[name].numpy(), rel=1e-3)


def test_units_and_self_collision(hand: HandModel, scene: SceneObjects) -> None:
    units = LengthUnits(collision=1.0, guidance=1.0)
    metres = SceneTerms(hand, LossConfig(units=units))(*grasps(hand), scene, ALL)
    scaled = LossConfig(units=LengthUnits(collision=1e-3, guidance=0.1))
    other = SceneTerms(hand, scaled)(*grasps(hand), scene, ALL)
    assert torch.allclose(other["guidance"], 100 * metres["guidance"])
    assert torch.allclose(other["collision"], 1e6 * metres["collision"])
    assert torch.equal(other["q1_upper"], metres["q1_upper"])
    alone = LossConfig(units=units, self_collision=False)
    without = SceneTerms(hand, alone)(*grasps(hand), scene, ALL)
    # No self-collision here, so only the number of meshes differs: 3 or 2, and the links.
    meshes = torch.tensor([3.0, 2.0])
    ratio = (meshes + hand.links) / meshes
    assert torch.allclose(without["collision"], ratio * metres["collision"])


def test_weights() -> None:
    weights = LossWeights(chamfer=2, collision=0, guidance=3, q1_upper=0)
    assert active_terms(weights) == ["chamfer", "guidance"]
    terms = {"chamfer": torch.tensor([1.0, 2.0]), "guidance": torch.tensor([10.0, 20.0])}
    assert weighted_sum(terms, weights).tolist() == [32, 64]
    with pytest.raises(DmfcError, match="unknown loss 'guidence'"):
        weighted_sum({"guidence": torch.zeros(1)}, weights)
    with pytest.raises(ValueError, match="needs a term"):
        weighted_sum({}, weights)


def test_joints_beyond_a_limit_are_clamped_and_have_no_gradient(
    hand: HandModel, scene: SceneObjects
) -> None:
    terms = SceneTerms(hand, LossConfig())
    position, rotation, joints = grasps(hand)
    lower, upper = torch.from_numpy(hand.lower), torch.from_numpy(hand.upper)
    joints = joints.clamp(lower + 0.01, upper - 0.01)
    joints[0, 3], joints[1, 5] = upper[3] + 0.4, lower[5] - 0.4
    joints.requires_grad_()
    value = terms(position, rotation, joints, scene, ["guidance"])["guidance"]
    inside = torch.minimum(torch.maximum(joints.detach(), lower), upper)
    assert torch.equal(value, terms(position, rotation, inside, scene, ["guidance"])["guidance"])
    gradient = torch.autograd.grad(value.sum(), joints)[0]
    assert gradient[0, 3] == gradient[1, 5] == 0
    assert (gradient != 0).any(dim=1).all()
