"""The throughput script on a CPU, in its smallest form."""

from __future__ import annotations

import pytest
import torch

from tests.benchmarks.throughput import Throughput, measure, report, table2_minutes
from tests.support.toy import NETWORK, toy_hand


def test_projected_time_is_that_of_all_steps():
    pretrain = Throughput("pretrain", 4, 0.010, 0)  # 2,500 steps per epoch: 50 epochs, 20 epochs
    finetune = Throughput("finetune", 4, 0.025, 0)
    assert table2_minutes(pretrain, finetune) == pytest.approx(
        (125_000 * 0.010 + 50_000 * 0.025) / 60
    )


@pytest.mark.parametrize("precision", ["32-true", "bf16-mixed"])
def test_both_stages_are_measured_on_a_cpu(precision):
    device = torch.device("cpu")
    pretrain, finetune = (
        measure(stage, toy_hand(), device, precision, 2, 1, NETWORK, points=128, labels=8)
        for stage in ("pretrain", "finetune")
    )
    assert pretrain.scenes_per_second > 0
    text = report(pretrain, finetune, precision, "cpu")
    assert "pretrain" in text
    assert "Table II (10000 scenes, 70 epochs)" in text
