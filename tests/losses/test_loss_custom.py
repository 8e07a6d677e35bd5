"""Terms that are functions of the user's own."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch

from dmfc.config.losses import LossConfig
from dmfc.errors import DmfcError
from dmfc.geometry.transforms import transform
from dmfc.hand.kinematics import HandKinematics
from dmfc.hand.model import HandModel
from dmfc.losses.task import SceneTerms
from dmfc.objects.atlas import SceneObjects
from tests.losses.test_loss_task import grasps

FILE = """
import torch

def nearest(hands):
    # distance of a point ahead of the palm to the closest object, [n]
    ahead = hands.position + hands.rotation @ torch.tensor([0, -0.03, 0.11]).to(hands.position)
    return -hands.objects.distance(ahead[:, None]).amax(dim=(1, 2))

def tips(hands):
    return hands.T_world_link[:, -1, 2, 3] + hands.inner[..., 2].amin(1) + hands.joints.sum(1)

def three(hands):
    return torch.zeros(3)

def number(hands):
    return 1.0
"""


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "mine.py"
    path.write_text(FILE)
    return path


def test_a_term_is_what_its_function_gives(hand: HandModel, scene: SceneObjects, file: Path):
    terms = SceneTerms(hand, LossConfig(custom={f"{file}:nearest": 1.0, f"{file}:tips": 2.0}))
    position, rotation, joints = grasps(hand)
    position.requires_grad_()
    names = ["custom_nearest", "custom_tips"]
    found = terms(position, rotation, joints, scene, names)
    assert list(found) == names

    # `grasps` has the centre of the ball of 4 cm at (0, -4, 8) cm; this is (0, 1, 3) cm from it.
    assert found["custom_nearest"].tolist() == pytest.approx([0.1**0.5 / 10 - 0.04] * 2, abs=1e-3)
    (gradient,) = torch.autograd.grad(found["custom_nearest"].sum(), position)
    outward = rotation @ torch.tensor([0, 0.01, 0.03]).double() / (0.1**0.5 / 10)
    assert gradient.numpy() == pytest.approx(outward.numpy(), abs=0.05)

    kinematics, T_world_palm = HandKinematics(hand), transform(rotation, position)
    held = kinematics.clamp(joints)
    lowest = kinematics.inner_points(T_world_palm, held)[0][..., 2].amin(1)
    last = kinematics.links(T_world_palm, held)[:, -1, 2, 3]
    torch.testing.assert_close(found["custom_tips"], last + lowest + held.sum(1))


def test_only_what_is_wanted_is_computed(hand: HandModel, scene: SceneObjects, file: Path):
    terms = SceneTerms(hand, LossConfig(custom={f"{file}:three": 1.0}))
    assert set(terms(*grasps(hand), scene, ["guidance"])) == {"guidance"}


@pytest.mark.parametrize(
    ("name", "message"), [("three", r"'three' gave \[3\]"), ("number", "'number' gave float")]
)
def test_another_shape_is_refused(hand, scene, file, name, message):
    terms = SceneTerms(hand, LossConfig(custom={f"{file}:{name}": 1.0}))
    with pytest.raises(DmfcError, match=message + r" where one value per grasp .* \[2\]"):
        terms(*grasps(hand), scene, [f"custom_{name}"])


def test_two_functions_of_one_name_are_refused(hand, file):
    other = file.with_name("other.py")
    other.write_text(FILE)
    with pytest.raises(DmfcError, match="two functions are named 'tips'"):
        SceneTerms(hand, LossConfig(custom={f"{file}:tips": 1.0, f"{other}:tips": 1.0}))
