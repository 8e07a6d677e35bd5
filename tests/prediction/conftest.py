"""A model folder with random weights, small enough to be asked in milliseconds."""

from __future__ import annotations

import json

import pytest
import torch
from omegaconf import OmegaConf
from safetensors.torch import save_file

from dmfc.config.losses import LossConfig
from dmfc.config.training import TrainingConfig
from dmfc.hand.description import load_description
from dmfc.network.model import DmfcGraspNet
from tests.support import clouds
from tests.support.toy import NETWORK

LIMIT = 0.4


@pytest.fixture(scope="session")
def stage_folder(tmp_path_factory):
    """As a training stage leaves it, in a store with the stages of its data."""
    store = tmp_path_factory.mktemp("store")
    folder = store / "stages" / "pretrain" / "0123"
    folder.mkdir(parents=True)
    torch.manual_seed(0)
    joints = len(load_description("shadow").dof_names)
    net = DmfcGraspNet(NETWORK, torch.full((joints,), -LIMIT), torch.full((joints,), LIMIT))
    for head in (net.offset_head, net.rotation_head, net.joints_head, net.confidence_head):
        torch.nn.init.normal_(head[-1].weight, std=5.0)  # answers that differ
    save_file(net.state_dict(), folder / "weights.safetensors")
    settings = {"version": 1, "stage": "pretrain", "hand": "shadow"}
    for name, value in (
        ("network", NETWORK),
        ("losses", LossConfig()),
        ("training", TrainingConfig()),
    ):
        settings[name] = OmegaConf.to_container(OmegaConf.structured(value))
    OmegaConf.save(OmegaConf.create(settings), folder / "config.yaml")
    inputs = {"objects": ["object/a", "object/b"], "scenes": ["scenes/x", "scenes/y"]}
    record = {"kind": "pretrain", "key": "0123", "commit": "abcdef0123", "inputs": inputs}
    (folder / "stage.json").write_text(json.dumps(record))
    for first, name in ((0, "x"), (5, "y")):
        shard = store / "stages" / "scenes" / name
        shard.mkdir(parents=True)
        config = {"start": first, "stop": first + 5, "set": {"kind": "multi"}}
        (shard / "stage.json").write_text(
            json.dumps({"config": {**config, "scenes": {"points": 2048}}})
        )
    return folder


@pytest.fixture(scope="session")
def blob():
    return clouds.blob()
