"""Predictions as flat rows, each with the label nearest to it."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import torch
from torch import Tensor

from dmfc.geometry.rotations import matrix_from_6d, sixd_from_matrix
from dmfc.network.model import Prediction

Batch = dict[str, Tensor]
"""What `dmfc.scenes.dataset.collate` makes; shapes are told there."""


@dataclass(frozen=True)
class Candidates:
    """n predicted grasps of a batch, world frame.

    scene `[n]`: row in the batch; position `[n,3]`, rotation6d `[n,6]`, joints `[n,J]` (raw), logit
    `[n]`; positive `[n]`: has a label; label_position, label_rotation `[n,3,3]`, label_joints: the
    nearest of its matched labels in grasp space (anything where not positive).
    """

    scene: Tensor
    position: Tensor
    rotation6d: Tensor
    joints: Tensor
    logit: Tensor
    positive: Tensor
    label_position: Tensor
    label_rotation: Tensor
    label_joints: Tensor

    def __len__(self) -> int:
        return len(self.scene)

    @property
    def rotation(self) -> Tensor:
        """R_world_palm `[n,3,3]`."""
        return matrix_from_6d(self.rotation6d[:, :3], self.rotation6d[:, 3:])

    def take(self, index: Tensor) -> Candidates:
        """The rows at `index` (or where a mask is true)."""
        values = {f.name: getattr(self, f.name)[index] for f in dataclasses.fields(self)}
        return Candidates(**values)


def candidates(prediction: Prediction, batch: Batch, joint_weight: float) -> Candidates:
    """All `B*m` predictions, in float32 whatever the network's precision."""
    size, seeds = prediction.logit.shape
    label = nearest_label(prediction, batch, joint_weight)
    row = torch.arange(size, device=label.device)[:, None]

    def flat(values: Tensor) -> Tensor:
        return values.flatten(0, 1)

    return Candidates(
        scene=flat(row.expand(size, seeds)),
        position=flat(prediction.position.float()),
        rotation6d=flat(prediction.rotation6d.float()),
        joints=flat(prediction.joints.float()),
        logit=flat(prediction.logit.float()),
        positive=flat(batch["match"].any(-1)),
        label_position=flat(batch["grasp_position"][row, label]),
        label_rotation=flat(batch["grasp_rotation"][row, label]),
        label_joints=flat(batch["grasp_joints"][row, label]),
    )


@torch.no_grad()
def nearest_label(prediction: Prediction, batch: Batch, joint_weight: float) -> Tensor:
    """Index `[B,m]` of the matched label with the smallest 27-D distance; 0 where none matches.

    Only the index: |p - g|^2 = |p|^2 + |g|^2 - 2 p.g is one matrix product for all pairs, but too
    rough for a loss. The smallest distance then equals, and has the gradient of, the minimum.
    """
    scale = joint_weight**0.5
    sixd = sixd_from_matrix(batch["grasp_rotation"])
    labels = torch.cat([batch["grasp_position"], sixd, scale * batch["grasp_joints"]], -1)
    ours = torch.cat(
        [prediction.position, prediction.rotation6d, scale * prediction.joints], -1
    ).float()
    centre = labels.mean((0, 1))  # smaller numbers, smaller rounding
    labels, ours = labels - centre, ours - centre
    distance = labels.square().sum(-1)[:, None] - 2 * ours @ labels.mT
    return distance.masked_fill(~batch["match"], torch.inf).argmin(-1)
