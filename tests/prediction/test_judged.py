"""A model with an outcome predictor: its confidence is the predictor's, wherever the cloud lies."""

from __future__ import annotations

import shutil

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from dmfc.config.outcome import OutcomeConfig
from dmfc.errors import DmfcError
from dmfc.outcome.features import FeatureMaker, SeededGrasps
from dmfc.outcome.fit import fit
from dmfc.outcome.judge import Judge, save_judge
from dmfc.outcome.network import OutcomeNet
from dmfc.prediction.models import JUDGE_CARD, add_judge
from dmfc.prediction.planner import load
from tests.outcome.test_fit import CONFIG, planted
from tests.support.grasp_shapes import shadow


@pytest.fixture(scope="module")
def judged(shadow_hand_dir, stage_folder, tmp_path_factory):
    """The model's folder with a predictor of random weights."""
    folder = tmp_path_factory.mktemp("judged")
    for name in ("weights.safetensors", "config.yaml"):
        shutil.copyfile(stage_folder / name, folder / name)
    hand = shadow()[0]
    torch.manual_seed(4)
    net = OutcomeNet(len(FeatureMaker(hand).names), [8], 2)
    net.scale[:] = 0.1
    _, report = fit(planted(), CONFIG, 0, folder / "work")
    made = folder / "made"
    save_judge(net, OutcomeConfig(widths=[8], members=2), hand, report, made)
    card = add_judge(made, folder, "Measured here.").read_text()
    assert card == (folder / JUDGE_CARD).read_text()
    assert "Measured here." in card
    assert f"{report.held_auc_within:.3f}" in card
    return folder


def test_the_confidence_is_the_predictors_and_ranks(judged, blob):
    planner = load(judged)
    points = blob[:2048]
    own, found = planner(points, score="confidence"), planner(points)
    assert (np.diff(found.confidence) <= 0).all()
    assert found.confidence.std() > 1e-3
    height = np.array([0, 0, points[:, 2].min()])
    grasps = SeededGrasps(
        own.T_cloud_palm[:, :3, 3] - height,
        own.T_cloud_palm[:, :3, :3],
        own.joints,
        own.point,
        own.confidence,
    )
    said = Judge.load(judged)(grasps, points - height).held
    by_point = dict(zip(own.point, said, strict=True))
    expected = [by_point[p] for p in found.point]
    np.testing.assert_allclose(found.confidence, expected, atol=2e-3)


def test_it_does_not_depend_on_where_the_cloud_lies(judged, blob):
    planner, points = load(judged), blob[:2048]
    turn = Rotation.from_rotvec([0.3, -0.8, 0.5]).as_matrix()
    moved = planner(points @ turn.T + [0.2, 0.1, -0.4], up=turn[:, 2])
    usual = planner(points)
    gap = np.abs(np.sort(moved.confidence) - np.sort(usual.confidence))
    assert np.quantile(gap, 0.9) < 0.02


def test_a_score_that_there_is_not_is_said_on_one_line(judged, stage_folder, blob):
    with pytest.raises(DmfcError, match="did you mean 'outcome'"):
        load(judged)(blob, score="outcom")
    with pytest.raises(DmfcError, match="has no outcome predictor"):
        load(stage_folder)(blob, score="outcome")
