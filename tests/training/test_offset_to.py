"""Offsets that lead to what the hand holds: poses against scipy, labels against themselves."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import torch
from safetensors.torch import save_file
from scipy.spatial.transform import Rotation

from dmfc.config.losses import GraspSpace
from dmfc.config.network import NetworkConfig
from dmfc.geometry.rotations import sixd_from_matrix
from dmfc.network.checkpoint import new_network
from dmfc.network.model import Prediction
from dmfc.training.candidates import Candidates
from dmfc.training.measures import label_errors
from tests.support.toy import NETWORK, toy_batch, toy_hand

CENTRE = torch.tensor([0.01, -0.02, 0.09])


def at_labels(batch, turn: Rotation) -> Prediction:
    """At each seed its first label, turned about CENTRE by `turn` (world frame)."""
    row = torch.arange(len(batch.scene_number))[:, None]
    label = batch.match.float().argmax(-1)
    seeds = batch.points[row, batch.seed_index]
    rotation = batch.grasp_rotation[row, label]
    aim = batch.grasp_position[row, label] + rotation @ CENTRE
    turned = torch.from_numpy(turn.as_matrix()).float() @ rotation
    return Prediction(
        seed_index=batch.seed_index,
        seeds=seeds,
        offset=aim - seeds,
        rotation6d=sixd_from_matrix(turned),
        joints=batch.grasp_joints[row, label],
        logit=torch.zeros(label.shape),
        centre=CENTRE,
    )


def test_position_is_the_origin_of_the_palm_whose_centre_is_at_the_aim():
    found = at_labels(toy_batch(), Rotation.from_rotvec([0.3, -0.2, 0.5]))
    rotation = Rotation.from_matrix(found.rotation.reshape(-1, 3, 3).numpy())
    centre = found.position.reshape(-1, 3).numpy() + rotation.apply(CENTRE.numpy())
    np.testing.assert_allclose(centre, found.aim.reshape(-1, 3).numpy(), atol=1e-6)


def test_a_label_turned_about_the_centre_is_off_in_rotation_alone():
    batch = toy_batch()
    space = GraspSpace(joint_weight=0)
    exact = at_labels(batch, Rotation.identity())
    rows = Candidates.of(exact, batch, space)
    assert rows.chamfer.max() < 1e-9
    row = torch.arange(len(batch.scene_number))[:, None]
    label = batch.match.float().argmax(-1)
    torch.testing.assert_close(exact.position, batch.grasp_position[row, label])

    errors = label_errors(at_labels(batch, Rotation.from_rotvec([0, 0, 0.1])), batch, space)
    assert errors["translation_mm"].median() < 1e-3
    assert errors["rotation_deg"].median() == pytest.approx(np.rad2deg(0.1), abs=1e-2)
    at_wrist = dataclasses.replace(
        at_labels(batch, Rotation.from_rotvec([0, 0, 0.1])), centre=torch.zeros(3)
    )
    moved = at_wrist.aim - at_labels(batch, Rotation.identity()).position
    assert moved.norm(dim=-1).max() > 0.01


def test_the_centre_is_ahead_of_the_palm_and_is_kept_with_the_weights(tmp_path):
    hand = toy_hand()
    config = dataclasses.replace(NETWORK, offset_to="grasp", offset_ahead=0.03)
    net = new_network(config, hand)
    ahead = hand.palm_reference + 0.03 * hand.palm_normal
    np.testing.assert_allclose(net.centre.numpy(), ahead, atol=1e-7)
    assert new_network(NETWORK, hand).centre.abs().max() == 0
    assert NetworkConfig().offset_to == "grasp"

    save_file(net.state_dict(), tmp_path / "weights.safetensors")
    other = new_network(NETWORK, hand)
    other.load_state_dict(net.state_dict())
    points = torch.rand(1, 200, 3) * 0.1
    torch.testing.assert_close(other.eval()(points).position, net.eval()(points).position)
