"""Confidence: the task loss, weighted by how sure the network says it is."""

from __future__ import annotations

from torch import Tensor
from torch.nn.functional import logsigmoid


def confidence_loss(task: Tensor, logit: Tensor, weight: float) -> Tensor:
    """mean_i (c_i * task_i - weight * log c_i), c = sigmoid(logit); a scalar.

    task: [n]; logit: [n], before the sigmoid, which keeps log c finite. For a given task loss the
    best confidence is min(weight / task_i, 1).
    """
    return (logit.sigmoid() * task - weight * logsigmoid(logit)).mean()
