"""Backbones by name, or `file.py:Class` of the user's own (setting `network.backbone`).

A backbone is a `torch.nn.Module`:

    class Mine(nn.Module):
        def __init__(self, config: NetworkConfig) -> None: ...

        def forward(self, points: Tensor, seed_index: Tensor, height: Tensor | None) -> Tensor: ...

`points` `[B, N, 3]`, metres from the centroid of each cloud; `seed_index` `[B, m]` int64, the m =
`config.levels[0]` points of each cloud that get a grasp, farthest points, so that the first k of
them are spread, too; `height` `[B, N, 1]` above the table in units of 0.1 m where
`network.height_feature` is set, else None. It returns `[B, m, config.features]`.
"""

from __future__ import annotations

from pathlib import Path

import torch
from torch import Tensor, nn

from dmfc.config.custom_function import custom_class, is_custom
from dmfc.config.network import NetworkConfig
from dmfc.errors import DmfcError, first_line, unknown_name
from dmfc.network.dgcnn import Dgcnn
from dmfc.network.model_files import BACKBONE
from dmfc.network.pointnet import PointNet
from dmfc.network.pointnet2 import PointNet2

SETTING = "network.backbone"
BACKBONES: dict[str, type[nn.Module]] = {
    "pointnet2": PointNet2,
    "dgcnn": Dgcnn,
    "pointnet": PointNet,
}


def make_backbone(config: NetworkConfig, folder: Path | None = None) -> nn.Module:
    """The backbone of `config`. `folder`: of a trained model, with its copy of the user's file.

    Raises DmfcError where there is none of that name, or it cannot be made.
    """
    text = config.backbone
    if not is_custom(text):
        if text not in BACKBONES:
            raise DmfcError(f"{SETTING}: {unknown_name('backbone', text, BACKBONES)}")
        return BACKBONES[text](config)
    if folder is not None:
        text = f"{folder / BACKBONE}:{text.partition(':')[2]}"
    try:
        made = custom_class(text, SETTING).load()(config)
    except DmfcError:
        raise
    except Exception as error:  # whatever the user's class raises
        raise DmfcError(
            f"{SETTING}: '{text}' cannot be made: {type(error).__name__}: {first_line(error)}"
        ) from error
    if not isinstance(made, nn.Module):
        raise DmfcError(f"{SETTING}: '{text}' is no torch.nn.Module")
    return made


def require_features(features: Tensor, seed_index: Tensor, config: NetworkConfig) -> None:
    """Raise DmfcError where a backbone answers with another shape than it should."""
    wanted = (*seed_index.shape, config.features)
    if not isinstance(features, torch.Tensor) or tuple(features.shape) != wanted:
        given = list(features.shape) if isinstance(features, Tensor) else type(features).__name__
        raise DmfcError(
            f"{SETTING}: '{config.backbone}' gave {given} where a tensor {list(wanted)} is wanted: "
            "clouds, seed points, network.features"
        )
