"""The contract of a backbone, of each shipped one and of one in a user's file."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import torch

from dmfc.config.network import NetworkConfig
from dmfc.errors import DmfcError
from dmfc.geometry.points import farthest_points, take_points
from dmfc.network.backbones import BACKBONES, make_backbone
from dmfc.network.checkpoint import load_network
from dmfc.network.dgcnn import EdgeConvolution
from dmfc.network.inference import predict
from dmfc.network.model import DmfcGraspNet
from tests.network.test_model import SMALL, cloud, outputs
from tests.support.pages import write_files
from tests.support.toy import toy_hand

SHIPPED = sorted(BACKBONES)


def net(config: NetworkConfig) -> DmfcGraspNet:
    torch.manual_seed(0)
    made = DmfcGraspNet(config, torch.full((18,), -0.5), torch.full((18,), 1.5)).double().eval()
    with torch.no_grad():
        for module in made.modules():
            if isinstance(module, torch.nn.Linear):
                module.weight.normal_(std=(2 / module.in_features) ** 0.5)
    return made


@pytest.mark.parametrize("height", [False, True])
@pytest.mark.parametrize("name", SHIPPED)
def test_features_are_of_the_seeds_and_know_no_origin_and_no_order(name, height):
    config = dataclasses.replace(SMALL, backbone=name, height_feature=height)
    made, points = net(config), cloud()
    index = farthest_points(points, 32)
    with torch.no_grad():
        first = outputs(made(points, index))
        assert [tuple(part.shape[:2]) for part in first] == [(2, 32)] * 4
        moved = outputs(made(points + torch.tensor([0.3, -0.2, 0.0]), index))
        order = torch.randperm(points.shape[1], generator=torch.Generator().manual_seed(1))
        where = torch.argsort(order)
        shuffled = outputs(made(points[:, order], where[index]))
    for one, other, third in zip(first, moved, shuffled, strict=True):
        torch.testing.assert_close(one, other, rtol=0, atol=1e-9)
        if name != "pointnet2":  # of a full ball it takes the first points
            torch.testing.assert_close(one, third, rtol=0, atol=1e-9)
    lifted = outputs(made(points + torch.tensor([0.0, 0.0, 0.5]), index))
    same = all(torch.allclose(one, two, atol=1e-9) for one, two in zip(first, lifted, strict=True))
    assert same != height


@pytest.mark.parametrize("name", SHIPPED)
def test_every_parameter_learns(name):
    made = net(dataclasses.replace(SMALL, backbone=name)).train()
    sum(part.square().sum() for part in outputs(made(cloud()))).backward()
    assert all(part.grad is not None for part in made.parameters())
    assert all(part.grad.abs().sum() > 0 for part in made.backbone.parameters() if part.ndim == 2)


def test_an_edge_convolution_is_the_maximum_over_the_nearest():
    """Against loops over points and edges."""
    torch.manual_seed(2)
    layer = EdgeConvolution(5, 7, 4).double().eval()
    at, among = torch.randn(2, 6, 5).double(), torch.randn(2, 9, 5).double()
    found = layer(at, among)
    linear, norm = layer.layers[0], layer.layers[1]
    for b in range(2):
        for i in range(6):
            distance = (among[b] - at[b, i]).norm(dim=1)
            edges = [
                linear(torch.cat([at[b, i], among[b, j] - at[b, i]]))
                for j in distance.argsort()[:4]
            ]
            scaled = torch.stack(edges) / (1 + norm.eps) ** 0.5  # its statistics are 0 and 1
            wanted = torch.relu(scaled).amax(dim=0)
            torch.testing.assert_close(found[b, i], wanted, rtol=1e-9, atol=1e-9)


def test_a_backbone_of_the_page_is_trained_kept_and_read_without_its_file(tmp_path, monkeypatch):
    from tests.training.test_fit import CONFIG, run

    write_files("extend.md", tmp_path)
    monkeypatch.chdir(tmp_path)
    network = dataclasses.replace(CONFIG.network, backbone="my_net.py:Nearest")
    training = dataclasses.replace(
        CONFIG.training, pretrain=dataclasses.replace(CONFIG.training.pretrain, epochs=1)
    )
    config = dataclasses.replace(CONFIG, network=network, training=training)
    run(tmp_path, config=config)
    (tmp_path / "my_net.py").unlink()
    loaded = load_network(tmp_path / "pretrain", toy_hand())
    points = np.random.default_rng(0).uniform(-0.05, 0.05, (200, 3)).astype(np.float32)
    assert np.isfinite(predict(loaded, points).position).all()
    # Its features are those of the 16 points around a seed alone: what is farther does not matter.
    index = torch.zeros(1, 1, dtype=torch.int64)
    near = torch.from_numpy(points)[None]
    distance = (near - near[:, :1]).norm(dim=2)[0]
    far = near.clone()
    far[0, distance.argsort()[16:]] += 1.0
    features = [loaded.backbone(each, index, None) for each in (near, far)]
    torch.testing.assert_close(*features)


@pytest.mark.parametrize(
    ("body", "message"),
    [
        ("def __init__(self, config): raise KeyError('x')", "cannot be made: KeyError: 'x'"),
        ("def __init__(self, config): pass", "is no torch.nn.Module"),
    ],
)
def test_a_class_that_cannot_be_made_is_one_line(tmp_path, body, message):
    (tmp_path / "net.py").write_text(f"class Mine:\n    {body}\n")
    config = dataclasses.replace(SMALL, backbone=f"{tmp_path}/net.py:Mine")
    with pytest.raises(DmfcError, match=message):
        make_backbone(config)


def test_another_shape_and_an_unknown_name_are_one_line(tmp_path):
    (tmp_path / "net.py").write_text(
        "import torch\nclass Mine(torch.nn.Module):\n"
        "    def __init__(self, config): super().__init__()\n"
        "    def forward(self, points, seed_index, height): return points\n"
    )
    made = net(dataclasses.replace(SMALL, backbone=f"{tmp_path}/net.py:Mine"))
    with pytest.raises(DmfcError, match=r"gave \[2, 100, 3\] where a tensor \[2, 32, 16\]"):
        made(cloud())
    with pytest.raises(DmfcError, match="did you mean 'pointnet'"):
        make_backbone(dataclasses.replace(SMALL, backbone="pointnet3"))


def test_the_tiny_one_sees_the_cloud_as_one_vector():
    """Two seeds at one place have the same features, whatever is around each."""
    made = make_backbone(dataclasses.replace(SMALL, backbone="pointnet")).double().eval()
    points = cloud(1)
    points[0, 5] = points[0, 9]
    index = torch.tensor([[5, 9]])
    found = made(points, index, None)
    torch.testing.assert_close(found[:, 0], found[:, 1])
    assert not torch.equal(take_points(points, index)[0, 0], points[0, 0])
