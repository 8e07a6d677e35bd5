"""Chamfer: squared distance to the closest matching label, in the space of grasp vectors."""

from __future__ import annotations

import torch
from torch import Tensor

from dmfc.config.losses import GraspSpace


def grasp_vector(position: Tensor, rotation6d: Tensor, joints: Tensor, space: GraspSpace) -> Tensor:
    """The 27 numbers of a grasp: position / length_unit, (a, b), sqrt(joint_weight) * joints.

    [..., 3] in metres, [..., 6], [..., J] in rad -> [..., 9 + J]. Palm positions in the world serve
    as well as offsets from a seed point: their differences are the same.
    """
    scaled = position / space.length_unit, rotation6d, space.joint_weight**0.5 * joints
    return torch.cat(scaled, dim=-1)


def chamfer(prediction: Tensor, labels: Tensor, match: Tensor) -> Tensor:
    """chamfer_i = min_{g in G_i} |p_i - g|^2, and 0 where G_i is empty: [..., n].

    prediction: [..., n, C]; labels: [..., G, C]; match: [..., n, G] bool, label g is in G_i.
    """
    if labels.shape[-2] == 0:
        return prediction.new_zeros(prediction.shape[:-1])
    closest = closest_label(prediction, labels, match)[..., None]
    label = labels.gather(-2, closest.expand(*closest.shape[:-1], labels.shape[-1]))
    return grasp_distance(prediction, label) * match.any(dim=-1)


@torch.no_grad()
def closest_label(prediction: Tensor, labels: Tensor, match: Tensor) -> Tensor:
    """Index in labels of the closest of G_i, [..., n]; of any where G_i is empty. As `chamfer`.

    Only a choice: distances of all pairs lose digits to cancellation.
    """
    return torch.cdist(prediction, labels).masked_fill(~match, torch.inf).argmin(dim=-1)


def grasp_distance(prediction: Tensor, label: Tensor) -> Tensor:
    """|p - g|^2 of grasp vectors [..., C] and their labels [..., C], [...]."""
    return (prediction - label).square().sum(dim=-1)
