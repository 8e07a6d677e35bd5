"""Predictions of a batch as flat rows."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import torch
from torch import Tensor

from dmfc.config.losses import GraspSpace
from dmfc.geometry.rotations import matrix_from_6d, sixd_from_matrix
from dmfc.losses.chamfer import chamfer, closest_label, grasp_vector
from dmfc.network.model import Prediction
from dmfc.training.batch import Batch


@dataclass(frozen=True)
class Candidates:
    """n predicted grasps of a batch, world frame.

    scene `[n]`: row in the batch; position `[n,3]` of the palm, aim `[n,3]` of the point that
    offsets lead to, rotation6d `[n,6]`, joints `[n,J]` (raw), logit
    `[n]` of the confidence; positive `[n]`: has a label; label `[n]`: the nearest one of the scene
    (any without); chamfer `[n]`: distance to it, 0 without.
    """

    scene: Tensor
    position: Tensor
    aim: Tensor
    rotation6d: Tensor
    joints: Tensor
    logit: Tensor
    positive: Tensor
    label: Tensor
    chamfer: Tensor

    def __len__(self) -> int:
        return len(self.scene)

    @classmethod
    def of(cls, prediction: Prediction, batch: Batch, space: GraspSpace) -> Candidates:
        """All `B*m` predictions, in float32 whatever the network's precision."""
        prediction = prediction.float()
        size, seeds = prediction.logit.shape
        ours = prediction_vectors(prediction, space)
        labels = label_vectors(batch, space, prediction.centre)
        scene = torch.arange(size, device=ours.device)[:, None].expand(size, seeds)
        return cls(
            scene=scene.flatten(),
            position=prediction.position.flatten(0, 1),
            aim=prediction.aim.flatten(0, 1),
            rotation6d=prediction.rotation6d.flatten(0, 1),
            joints=prediction.joints.flatten(0, 1),
            logit=prediction.logit.flatten(),
            positive=batch.match.any(-1).flatten(),
            label=closest_label(ours, labels, batch.match).flatten(),
            chamfer=chamfer(ours, labels, batch.match).flatten(),
        )

    @property
    def rotation(self) -> Tensor:
        """R_world_palm `[n,3,3]`."""
        return matrix_from_6d(self.rotation6d[:, :3], self.rotation6d[:, 3:])

    def at_labels(self, batch: Batch) -> Candidates:
        """The hands moved to their labels; `aim` and `chamfer` stay as they are."""
        return dataclasses.replace(
            self,
            position=batch.grasp_position[self.scene, self.label],
            rotation6d=sixd_from_matrix(batch.grasp_rotation[self.scene, self.label]),
            joints=batch.grasp_joints[self.scene, self.label],
        )

    def take(self, index: Tensor) -> Candidates:
        """The rows at `index`, or where a mask is true."""
        values = {f.name: getattr(self, f.name)[index] for f in dataclasses.fields(self)}
        return Candidates(**values)


def prediction_vectors(prediction: Prediction, space: GraspSpace) -> Tensor:
    """The predictions in grasp space, `[B,m,9+J]`; their positions are those of `centre`."""
    return grasp_vector(prediction.aim, prediction.rotation6d, prediction.joints, space)


def label_vectors(batch: Batch, space: GraspSpace, centre: Tensor) -> Tensor:
    """The labels of each scene in grasp space, `[B,G,9+J]`; see `label_centres`."""
    sixd = sixd_from_matrix(batch.grasp_rotation)
    return grasp_vector(label_centres(batch, centre), sixd, batch.grasp_joints, space)


def label_centres(batch: Batch, centre: Tensor) -> Tensor:
    """Where the point `centre` `[3]` of the palm frame is at each label, `[B,G,3]`, metres."""
    return batch.grasp_position + batch.grasp_rotation @ centre
