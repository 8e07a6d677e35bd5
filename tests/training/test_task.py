"""The task loss of each stage: its terms, its ranking, and the measures beside it."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest
import torch

from dmfc.config.losses import GraspSpace, LossConfig, LossWeights, Q1Config
from dmfc.config.training import TrainingConfig
from dmfc.geometry.rotations import matrix_from_6d, sixd_from_matrix
from dmfc.network.checkpoint import new_network
from dmfc.network.model import Prediction
from dmfc.training.candidates import Candidates
from dmfc.training.failure import Failure
from dmfc.training.measures import label_errors
from dmfc.training.module import GraspTraining
from dmfc.training.settings import FitConfig
from dmfc.training.task import Task
from tests.support.toy import NETWORK, toy_atlas, toy_batch, toy_hand

LOSSES = LossConfig(weights=LossWeights(1.0, 10.0, 1.0, 0.5, 1.0), q1=Q1Config(directions=64))


NO_FAILURE = Failure(Path(), FitConfig(), "toy")


def task(stage="finetune", losses=LOSSES, rank_points=0, seeds="all") -> Task:
    return Task(stage, losses, toy_hand(), toy_atlas(), rank_points, seeds)


def prediction() -> tuple[Prediction, dict[str, torch.Tensor]]:
    torch.manual_seed(0)
    batch = toy_batch()
    return new_network(NETWORK, toy_hand())(batch.points, batch.seed_index), batch


def test_pretraining_is_chamfer_at_labelled_seeds_whatever_the_weights():
    predicted, batch = prediction()
    weights = dataclasses.replace(LOSSES.weights, chamfer=0.0)
    stage = task("pretrain", dataclasses.replace(LOSSES, weights=weights))
    rows = stage.candidates(predicted, batch)
    assert len(rows) == batch.match.any(-1).sum()
    terms = stage.terms(rows, batch)
    assert list(terms) == ["chamfer"]
    torch.testing.assert_close(stage.total(terms), rows.chamfer)


def test_seeds_without_a_label_are_left_out_of_fine_tuning_where_that_is_wanted():
    predicted, batch = prediction()
    everywhere = task().candidates(predicted, batch)
    labelled = task(seeds="labelled").candidates(predicted, batch)
    matched = batch.match.any(-1).flatten()
    assert 0 < matched.sum() < len(matched) == len(everywhere)
    torch.testing.assert_close(labelled.logit, everywhere.logit[matched])
    assert labelled.positive.all()


def test_a_term_of_the_users_own_counts_in_fine_tuning(tmp_path):
    file = tmp_path / "mine.py"
    file.write_text("def high(hands):\n    return hands.position[:, 2].abs()\n")
    predicted, batch = prediction()
    losses = dataclasses.replace(LOSSES, custom={f"{file}:high": 3.0})
    stage, plain = task(losses=losses, rank_points=20), task(rank_points=20)
    rows = stage.candidates(predicted, batch)
    terms = stage.terms(rows, batch)
    torch.testing.assert_close(terms["custom_high"], rows.position[:, 2].abs())
    more = 3 * rows.position[:, 2].abs()
    torch.testing.assert_close(stage.total(terms), plain.total(plain.terms(rows, batch)) + more)
    torch.testing.assert_close(stage.errors(rows, batch), plain.errors(rows, batch) + more)
    assert task("pretrain", losses).names == ["chamfer"]
    unused = dataclasses.replace(LOSSES, custom={f"{file}:high": 0})
    assert "custom_high" not in task(losses=unused).names


def test_chamfer_of_rows_equals_a_loop_over_labels():
    predicted, batch = prediction()
    rows = Candidates.of(predicted, batch, GraspSpace(length_unit=1.0, joint_weight=0.5))
    for row in range(0, len(rows), 5):
        scene, seed = divmod(row, 32)
        distances = [
            (predicted.position[scene, seed] - batch.grasp_position[scene, g]).square().sum()
            + (rows.rotation6d[row] - sixd_from_matrix(batch.grasp_rotation[scene, g]))
            .square()
            .sum()
            + 0.5 * (rows.joints[row] - batch.grasp_joints[scene, g]).square().sum()
            for g in batch.match[scene, seed].nonzero()[:, 0].tolist()
        ]
        assert bool(rows.positive[row]) == bool(distances)
        expected = min(distances) if distances else torch.tensor(0.0)
        torch.testing.assert_close(rows.chamfer[row], expected)


def test_exact_ranking_is_the_task_loss():
    predicted, batch = prediction()
    stage = task()
    rows = stage.candidates(predicted, batch)
    assert len(rows) == 4 * 32
    errors = stage.errors(rows, batch)
    assert not errors.requires_grad
    torch.testing.assert_close(errors, stage.total(stage.terms(rows, batch)))


def test_cheap_ranking_picks_most_of_the_same():
    predicted, batch = prediction()
    exact, cheap = task(), task(rank_points=20)
    rows = exact.candidates(predicted, batch)
    picked = [set(t.errors(rows, batch).topk(32).indices.tolist()) for t in (exact, cheap)]
    assert len(picked[0] & picked[1]) >= 28


@pytest.mark.parametrize("ranked_by", ["task", "weighted"])
def test_the_hardest_alone_get_gradients(ranked_by):
    _, batch = prediction()
    training = TrainingConfig(hard_error=ranked_by, hard_stages="both", hard_scope="batch")
    module = GraspTraining(new_network(NETWORK, toy_hand()), task(), training, NO_FAILURE)
    predicted = module.net(batch.points, batch.seed_index)
    rows = module.task.candidates(predicted, batch)
    rows = dataclasses.replace(rows, logit=torch.linspace(-4, 4, len(rows)))
    chosen = module.hardest(rows, batch)

    def error(of):
        sure = torch.sigmoid(of.logit) if ranked_by == "weighted" else 1.0
        return (sure * module.task.errors(of, batch)).tolist()

    assert len(chosen) == 64
    assert error(chosen) == pytest.approx(sorted(error(rows), reverse=True)[:64], rel=1e-4)


def test_a_thinned_hand_keeps_points_of_every_link():
    hand = toy_hand().thinned(20)
    assert len(hand.collision_points) == len(hand.collision_link) == 20
    assert set(hand.collision_link) == {0, 1, 2}
    np.testing.assert_array_equal(hand.collision_points, toy_hand().collision_points[::3])


def test_label_errors_are_in_the_units_they_say():
    _, batch = prediction()
    label = batch.match.float().argmax(-1)
    row = torch.arange(4)[:, None]
    turn = torch.tensor(0.1)
    about_z = matrix_from_6d(
        torch.stack([turn.cos(), turn.sin(), turn * 0]),
        torch.stack([-turn.sin(), turn.cos(), turn * 0]),
    )
    seeds = batch.points[row, batch.seed_index]
    position = batch.grasp_position[row, label] + torch.tensor([0.0, 0.003, 0.004])
    shifted = Prediction(
        seed_index=batch.seed_index,
        seeds=seeds,
        offset=position - seeds,
        rotation6d=sixd_from_matrix(about_z @ batch.grasp_rotation[row, label]),
        joints=batch.grasp_joints[row, label] + 0.02,
        logit=torch.zeros(4, 32),
    )
    errors = label_errors(shifted, batch, GraspSpace())
    assert len(errors["translation_mm"]) == batch.match.any(-1).sum()
    torch.testing.assert_close(errors["translation_mm"].median().item(), 5.0, rtol=1e-3, atol=0)
    torch.testing.assert_close(errors["rotation_deg"].median().item(), 5.7296, rtol=1e-3, atol=0)
    torch.testing.assert_close(errors["joints_deg"].median().item(), 1.1459, rtol=1e-3, atol=0)


def test_relative_terms_are_what_is_beyond_the_label():
    predicted, batch = prediction()
    plain, beyond = task(), task(losses=dataclasses.replace(LOSSES, relative=True))
    rows = plain.candidates(predicted, batch)
    names = ["collision", "guidance", "q1_upper"]
    at_labels = plain.terms(rows.at_labels(batch), batch)
    absolute, relative = plain.terms(rows, batch), beyond.terms(rows, batch)
    torch.testing.assert_close(relative["chamfer"], rows.chamfer)
    for name in names:
        expected = (absolute[name] - at_labels[name]).clamp(min=0)
        expected = torch.where(rows.positive, expected, absolute[name])
        torch.testing.assert_close(relative[name], expected)
    # A hand at its label costs nothing, and is not moved.
    there = beyond.terms(rows.take(rows.positive).at_labels(batch), batch)
    assert all((there[name] == 0).all() for name in names)


def test_labels_of_rows_are_those_of_chamfer():
    predicted, batch = prediction()
    space = GraspSpace(length_unit=1.0, joint_weight=1.0)
    rows = Candidates.of(predicted, batch, space)
    rows = rows.take(rows.positive)
    at = rows.at_labels(batch)
    apart = [
        (getattr(rows, name) - getattr(at, name)) for name in ("position", "rotation6d", "joints")
    ]
    torch.testing.assert_close(torch.cat(apart, dim=1).square().sum(1), rows.chamfer)
