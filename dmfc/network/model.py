"""DMFC-GraspNet: a cloud -> one 27-D grasp and a confidence at each seed point."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import torch
from torch import Tensor, nn

from dmfc.config.network import NetworkConfig
from dmfc.errors import DmfcError
from dmfc.geometry.points import farthest_points, take_points
from dmfc.geometry.rotations import matrix_from_6d
from dmfc.network.backbones import make_backbone, require_features
from dmfc.network.rows import RowLayers, row_layers

HEIGHT_UNIT_M = 0.1  # heights enter in units of it, so that they are of the size of 1
LAST_LAYER_STD = 0.01  # small, so that training starts from the biases below: a sane hand


@dataclass(frozen=True)
class Prediction:
    """Grasps at m seed points of B clouds, in the clouds' frame (world).

    seed_index `[B,m]` into the cloud; seeds `[B,m,3]` and offset `[B,m,3]` in metres; rotation6d
    `[B,m,6]` as (a, b); joints `[B,m,J]` in rad, not clamped; logit `[B,m]` of the confidence;
    centre `[3]`, the point of the hand that offsets lead to, palm frame.
    """

    seed_index: Tensor
    seeds: Tensor
    offset: Tensor
    rotation6d: Tensor
    joints: Tensor
    logit: Tensor
    centre: Tensor = field(default_factory=lambda: torch.zeros(3))

    def float(self) -> Prediction:
        """The same in float32, whatever precision the network ran in."""
        values = (
            self.seeds,
            self.offset,
            self.rotation6d,
            self.joints,
            self.logit,
            self.centre,
        )
        return Prediction(self.seed_index, *(value.float() for value in values))

    @property
    def confidence(self) -> Tensor:
        """`[B,m]` in (0, 1)."""
        return torch.sigmoid(self.logit)

    @property
    def aim(self) -> Tensor:
        """Where the hand's `centre` comes to be, `[B,m,3]` in metres: seed + offset."""
        return self.seeds + self.offset

    @property
    def position(self) -> Tensor:
        """Palm origin `[B,m,3]` in metres."""
        return self.aim - self.rotation @ self.centre

    @property
    def rotation(self) -> Tensor:
        """Palm orientation R_world_palm `[B,m,3,3]` by Gram-Schmidt (Zhou et al. 2019)."""
        return matrix_from_6d(self.rotation6d[..., :3], self.rotation6d[..., 3:])


class DmfcGraspNet(nn.Module):
    """A backbone (the paper: PointNet++) and four heads.

    `lower`, `upper`: the hand's joint limits `[J]`, rad; `centre` `[3]`: the point of the hand that
    offsets lead to, palm frame, metres (the palm's origin if not given).
    """

    lower: Tensor
    upper: Tensor
    centre: Tensor

    def __init__(
        self,
        config: NetworkConfig,
        lower: Tensor,
        upper: Tensor,
        centre: Tensor | None = None,
        *,
        folder: Path | None = None,
    ) -> None:
        """`folder`: of a trained model, which has its own copy of a backbone in a user's file."""
        super().__init__()
        self.config = config
        self.register_buffer("centre", torch.zeros(3) if centre is None else centre.clone())
        self.register_buffer("lower", lower.clone())
        self.register_buffer("upper", upper.clone())
        self.backbone = make_backbone(config, folder)
        identity = torch.tensor([1.0, 0.0, 0.0, 0.0, 1.0, 0.0])
        self.offset_head = grasp_head(config, torch.zeros(3))
        self.rotation_head = grasp_head(config, identity)
        self.joints_head = grasp_head(config, (lower + upper) / 2)
        self.confidence_head = grasp_head(config, torch.zeros(1))

    def forward(self, points: Tensor, seed_index: Tensor | None = None) -> Prediction:
        """`points` `[B,N,3]` in metres; `seed_index` `[B,m]`, their farthest points if known.

        Equivariant to translation: the network sees positions from the cloud's centroid (and, where
        `network.height_feature` is set, heights: then to horizontal translation only).
        """
        if seed_index is None:
            seed_index = farthest_points(points, self.config.levels[0])
        elif seed_index.shape[1] != self.config.levels[0]:
            raise DmfcError(
                f"the data has {seed_index.shape[1]} seeds per cloud, the network needs "
                f"{self.config.levels[0]} (network.levels)"
            )
        centred = points - points.mean(1, keepdim=True)
        height = points[..., 2:] / HEIGHT_UNIT_M if self.config.height_feature else None
        features = self.backbone(centred, seed_index, height)
        require_features(features, seed_index, self.config)
        rows = features.flatten(0, 1)

        def per_seed(head: nn.Sequential) -> Tensor:
            return head(rows).view(*seed_index.shape, -1)

        return Prediction(
            seed_index=seed_index,
            seeds=take_points(points, seed_index),
            offset=per_seed(self.offset_head),
            rotation6d=per_seed(self.rotation_head),
            joints=per_seed(self.joints_head),
            logit=per_seed(self.confidence_head).squeeze(-1),
            centre=self.centre,
        )


def grasp_head(config: NetworkConfig, start: Tensor) -> nn.Sequential:
    """Linear, norm and ReLU twice, then a Linear that answers about `start` `[n]` at first."""
    last = nn.Linear(config.width, len(start))
    nn.init.normal_(last.weight, std=LAST_LAYER_STD)
    with torch.no_grad():
        last.bias.copy_(start)
    return RowLayers(*row_layers([config.features, config.width, config.width]), last)
