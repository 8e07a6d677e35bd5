"""Distances of predictions from their labels, in millimetres and degrees."""

from __future__ import annotations

import torch
from torch import Tensor

from dmfc.config.losses import GraspSpace
from dmfc.geometry.rotations import geodesic_angle
from dmfc.network.model import Prediction
from dmfc.training.batch import Batch
from dmfc.training.candidates import label_centres, label_vectors, prediction_vectors


@torch.no_grad()
def label_errors(prediction: Prediction, batch: Batch, space: GraspSpace) -> dict[str, Tensor]:
    """Errors at each of the p seed points with a label, against the label nearest in grasp space.

    translation_mm of the point that offsets lead to, rotation_deg, joints_deg (root mean square
    over the joints): `[p]` each.
    """
    prediction = prediction.float()
    centre = prediction.centre
    apart = torch.cdist(prediction_vectors(prediction, space), label_vectors(batch, space, centre))
    nearest = apart.masked_fill(~batch.match, torch.inf).argmin(-1)
    scene, seed = batch.match.any(-1).nonzero(as_tuple=True)
    label = nearest[scene, seed]
    position = prediction.aim[scene, seed] - label_centres(batch, centre)[scene, label]
    angle = geodesic_angle(prediction.rotation[scene, seed], batch.grasp_rotation[scene, label])
    joints = prediction.joints[scene, seed] - batch.grasp_joints[scene, label]
    return {
        "translation_mm": 1000 * position.norm(dim=-1),
        "rotation_deg": torch.rad2deg(angle),
        "joints_deg": torch.rad2deg(joints.square().mean(-1).sqrt()),
    }
