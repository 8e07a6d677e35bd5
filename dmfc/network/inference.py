"""Grasps of a cloud by a trained network, as arrays."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch

from dmfc.errors import DmfcError
from dmfc.grasps.grasps import Grasps
from dmfc.network.model import DmfcGraspNet


@dataclass(frozen=True)
class PredictedGrasps(Grasps):
    """m grasps in the frame of the cloud (world), with joints within the hand's limits."""

    confidence: np.ndarray
    """[m] in (0, 1)."""
    seed_index: np.ndarray
    """[m] int64 point of the cloud that the grasp was predicted at."""


@torch.inference_mode()
def predict(net: DmfcGraspNet, points: np.ndarray) -> PredictedGrasps:
    """One grasp per seed point of the cloud `points` `[N,3]` in metres, most confident first.

    Raises DmfcError where the cloud is no such array, or not finite.
    """
    if points.ndim != 2 or points.shape[1] != 3 or not np.isfinite(points).all():
        raise DmfcError(f"a cloud of finite points [N,3] is needed, not {points.shape}")
    weight = net.lower
    cloud = torch.as_tensor(points, dtype=weight.dtype, device=weight.device)
    prediction = net.eval()(cloud[None])
    joints = prediction.joints.clamp(net.lower, net.upper)
    order = prediction.confidence[0].sort(descending=True, stable=True).indices

    def array(tensor: torch.Tensor) -> np.ndarray:
        values: np.ndarray = tensor[0][order].cpu().numpy()
        return values.astype(np.float64) if tensor.is_floating_point() else values

    return PredictedGrasps(
        position=array(prediction.position),
        rotation=array(prediction.rotation),
        joints=array(joints),
        confidence=array(prediction.confidence),
        seed_index=array(prediction.seed_index),
    )
