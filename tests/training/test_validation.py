"""Measures of validation against closed forms."""

from __future__ import annotations

import dataclasses

import pytest
import torch

from dmfc.config.losses import LossConfig
from dmfc.config.validation import ValidationConfig
from dmfc.geometry.rotations import sixd_from_matrix
from dmfc.network.model import Prediction
from dmfc.training.validation import Validation, calibration
from tests.support.toy import HALF, SEEDS, toy_atlas, toy_batch, toy_hand

CONFIG = ValidationConfig(confident=4, sampled=8)


def labelled(batch, lift: float = 0.0) -> Prediction:
    """Each seed's own label where it has one, moved up; the first label elsewhere."""
    row = torch.arange(len(batch.scene_number))[:, None]
    label = batch.match.float().argmax(-1)
    seeds = batch.points[row, batch.seed_index]
    position = batch.grasp_position[row, label] + torch.tensor([0, 0, lift])
    return Prediction(
        seed_index=batch.seed_index,
        seeds=seeds,
        offset=position - seeds,
        rotation6d=sixd_from_matrix(batch.grasp_rotation[row, label]),
        joints=batch.grasp_joints[row, label],
        logit=batch.match.any(-1).float(),
    )


def measure(prediction, batch, config=CONFIG):
    return Validation(config, LossConfig(), toy_hand(), toy_atlas()).measure(prediction, batch)


def test_labels_themselves_are_covered_and_moved_ones_are_not():
    batch = toy_batch()
    narrow = dataclasses.replace(CONFIG, near_distance=1e-3, near_angle=1e-2)
    found = measure(labelled(batch), batch, narrow)
    first = batch.match.float().argmax(-1)  # a seed can be only one of its labels
    assert found["coverage"].sum() == sum(len(row.unique()) for row in first)
    assert len(found["coverage"]) == batch.grasp_mask.sum()
    assert found["chamfer"].max() < 1e-10
    assert measure(labelled(batch, lift=1.0), batch)["coverage"].mean() == 0
    wide = dataclasses.replace(CONFIG, near_distance=1.1)
    assert measure(labelled(batch, lift=1.0), batch, wide)["coverage"].mean() == 1


def test_each_measure_is_of_as_many_predictions_as_it_says():
    batch = toy_batch()
    found = measure(labelled(batch), batch)
    assert {len(found[name]) for name in ("collision", "guidance", "q1_upper", "q1_lower")} == {32}
    assert len(found["penetration_mm"]) == len(found["measured_q1_upper"]) == 16
    assert (found["measured_q1_lower"] <= found["measured_q1_upper"] + 1e-6).all()


def test_penetration_is_the_depth_of_the_deepest_point():
    """A hand far under the table, and one in the middle of the box of scene 0."""
    batch = toy_batch(1)
    under = measure(labelled(batch, lift=-1.0), batch)["penetration_mm"]
    palm = labelled(batch).position[0, labelled(batch).logit[0].argmax()]
    assert under.max() == pytest.approx(1000 * (1 - palm[2].item()), abs=150)  # fingers are 10 cm
    prediction = labelled(batch)
    centre = batch.T_world_object[0, 0, :3, 3]
    inside = dataclasses.replace(prediction, offset=(centre - prediction.seeds[0])[None])
    assert measure(inside, batch)["penetration_mm"].max() <= 1000 * HALF.min() + 1e-3
    assert measure(inside, batch)["penetration_mm"].min() > 500 * HALF.min()
    assert measure(labelled(batch, lift=1.0), batch)["penetration_mm"].max() == 0
    assert prediction.seeds.shape[1] == SEEDS


def test_calibration():
    task = torch.tensor([0.5, 2.0, 4.0, 8.0])
    best = torch.tensor([1.0, 0.5, 0.25, 0.125])
    perfect = calibration(task, best, 1.0)
    assert perfect["confidence_gap"].abs().max() == 0
    assert perfect["confidence_rank"].tolist() == [1.0]
    turned = calibration(task, best.flip(0), 1.0)
    assert turned["confidence_rank"].item() == pytest.approx(-1)
    assert turned["confidence_gap"].numpy() == pytest.approx((best - best.flip(0)).abs().numpy())
    assert len(calibration(task, torch.full((4,), 0.5), 1.0)["confidence_rank"]) == 0
