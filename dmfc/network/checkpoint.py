"""The folder that a training stage leaves: its files, and the network read back from them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, cast

import numpy as np
import torch
from omegaconf import OmegaConf
from omegaconf.errors import OmegaConfBaseException
from safetensors import SafetensorError
from safetensors.torch import load_file

from dmfc.config.interpolation import refuse_interpolation
from dmfc.config.network import NetworkConfig
from dmfc.engine.record import verified
from dmfc.errors import DmfcError, one_line
from dmfc.hand.model import HandModel
from dmfc.network.model import DmfcGraspNet
from dmfc.network.model_files import CONFIG, WEIGHTS

_BROKEN = (OSError, AttributeError, ValueError, SafetensorError, OmegaConfBaseException)
"""What reading a folder raises that holds no trained network."""


def new_network(config: NetworkConfig, hand: HandModel, folder: Path | None = None) -> DmfcGraspNet:
    """An untrained network for `hand`, float32, with weights from torch's current random state.

    `folder`: see `DmfcGraspNet`.
    """
    limits = _inside(hand.lower, np.inf), _inside(hand.upper, -np.inf)
    return DmfcGraspNet(config, *limits, _centre(config, hand), folder=folder)


def load_network(folder: Path, hand: HandModel) -> DmfcGraspNet:
    """The trained network of a stage's `folder`, in evaluation mode.

    Raises DmfcError where the folder holds none, one for another hand, or a damaged one.
    """
    verified(folder)
    try:
        stored = OmegaConf.load(folder / CONFIG)
        trained_hand = stored.hand
        net = new_network(_network_config(stored), hand, folder)
    except _BROKEN as error:
        raise DmfcError(f"{folder} holds no trained network: {one_line(error)}") from error
    if trained_hand != hand.name:
        raise DmfcError(f"{folder} was trained for the hand '{trained_hand}', not '{hand.name}'")
    load_weights(net, folder)
    return net.eval()


def load_alone(folder: Path) -> tuple[DmfcGraspNet, str]:
    """The trained network of a stage's `folder` and the name of its hand, without that hand.

    Its joint limits and centre are those of the weights. Raises DmfcError where there is none, or a
    damaged one.
    """
    try:
        tensors = _tensors(folder)
        buffers = [tensors[name].float() for name in ("lower", "upper", "centre")]
        stored = OmegaConf.load(folder / CONFIG)
        net = DmfcGraspNet(_network_config(stored), *buffers, folder=folder)
        net.load_state_dict(tensors)
        hand = str(stored.hand)
    except (*_BROKEN, KeyError, RuntimeError) as error:
        raise DmfcError(f"{folder} holds no trained network: {one_line(error)}") from error
    return net.eval(), hand


def load_weights(net: DmfcGraspNet, folder: Path) -> None:
    """Fill `net` with the weights of a stage's `folder`; they must fit exactly.

    Raises DmfcError where they do not, or where they are damaged or not finite.
    """
    try:
        net.load_state_dict(_tensors(folder))
    except (OSError, SafetensorError, RuntimeError) as error:
        raise DmfcError(
            f"the weights in {folder} do not fit this network and hand: {one_line(error)} "
            "(network.*, hand.name)"
        ) from error


def require_finite(tensors: Mapping[str, torch.Tensor], what: str) -> None:
    """Raise DmfcError where one of the tensors holds NaN or infinity; `what` names them."""
    for name, tensor in tensors.items():
        wrong = int((~torch.isfinite(tensor)).sum()) if tensor.is_floating_point() else 0
        if wrong:
            raise DmfcError(f"{what}: '{name}' has {wrong} numbers that are not finite")


def _tensors(folder: Path) -> dict[str, torch.Tensor]:
    """The weights in a folder, compared with the digests of its stage, and finite."""
    verified(folder)
    tensors = load_file(folder / WEIGHTS)
    require_finite(tensors, f"{folder / WEIGHTS} cannot be used, train or copy it again")
    return tensors


def _network_config(stored: Any) -> NetworkConfig:
    refuse_interpolation(stored, CONFIG)
    config = OmegaConf.merge(OmegaConf.structured(NetworkConfig), stored.network)
    return cast(NetworkConfig, OmegaConf.to_object(config))


def _centre(config: NetworkConfig, hand: HandModel) -> torch.Tensor:
    if config.offset_to == "origin":
        return torch.zeros(3)
    ahead = hand.palm_reference + config.offset_ahead * hand.palm_normal
    return torch.from_numpy(ahead.astype(np.float32))


def _inside(limit: np.ndarray, towards: float) -> torch.Tensor:
    """`limit` in float32, rounded into the range: a clamped joint is within the exact limits."""
    rounded = limit.astype(np.float32)
    outside = (rounded - limit) * np.sign(towards) < 0
    return torch.from_numpy(np.where(outside, np.nextafter(rounded, np.float32(towards)), rounded))
